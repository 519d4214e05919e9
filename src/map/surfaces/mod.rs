//! The surfaces a map says there are, and the distance to them.
//!
//! A vector field describes surfaces well and the space between them badly: where it jumps, at the cut locus, a spline
//! passes through zero, and that is where robots drive. So distance is a property of the *surfaces*. They are kept as
//! [`Facet`]s, short straight pieces: of a vector map the surfels, each moved along its normal to where the field
//! vanishes as seen from its own side (a thin wall has two faces, and between them the field is nearly zero all over);
//! of a signed map the pieces of its zero lines. A distance is that to the nearest point `q` of any facet, along
//! `d = (p - q) / |p - q|`, and its variance
//!
//! ```text
//! (n.d)^2 (sigma^2 + (STRAY h)^2) + (t.d)^2 (END h)^2
//! ```
//!
//! with `n`, `t` the facet's normal and tangent, `sigma` the field's standard deviation across it, and the second term
//! for where the surface ends: somewhere between two beams. Where surfaces in other directions are nearly as near, the
//! distance is the least of several uncertain ones, whose spread is Clark's (1961).

mod bridges;
mod facet;
pub(crate) mod level;
pub(crate) mod lines;
mod nearby;
pub(crate) mod samples;
mod simple;
mod walls;

use rstar::primitives::{GeomWithData, Line};
use rstar::{AABB, RTree};

use self::facet::LEAST_LENGTH;
pub(crate) use self::facet::STRAY;
pub use self::facet::{Facet, Foot};
use self::nearby::{Nearby, Surroundings, nearest_of_all, within_of_all};
use super::Field;
use crate::fit::Surfels;
use crate::geometry::{Vec2, distance_to_segment, nearest_on_segment};
use crate::spline::Lattice;
use crate::uncertainty::Kind;

/// Surfaces whose directions have a cosine below this are different ones.
const RIVAL: f64 = 0.5;
/// A map's facets and an index over them; see the module.
#[derive(Debug)]
pub struct Surfaces {
    facets: Vec<Facet>,
    tree: nearby::Tree,
    nearby: Nearby,
    /// The lattice's, metres.
    resolution: f64,
}

impl Surfaces {
    /// The surfels of a vector field, moved to where it vanishes.
    pub fn of_surfels(field: &Field, surfels: &Surfels) -> Self {
        let facets = surfels.all.iter().filter_map(|surfel| {
            let (a, b) = surfel.ends();
            let vector = field.vector(surfel.anchor)?.vector;
            let step = surfel.normal * surfel.normal.dot(&vector);
            let sigma = KINDS.map(|kind| field.sigma_along(surfel.anchor, surfel.normal, kind));
            let open = surfel.goes_on.map(|goes_on| !goes_on);
            Some(Facet { ends: [a - step, b - step], sigma: [sigma[0]?, sigma[1]?], open })
        });
        Self::new(facets.collect(), field.lattice())
    }

    /// The pieces of lines on which a field vanishes.
    pub fn of_lines(field: &Field, lines: &[Vec<Vec2>]) -> Self {
        let resolution = field.lattice().resolution;
        let facets = lines.iter().flat_map(|line| {
            let line = simple::simplified(line, TOLERANCE * resolution, 0.5 * resolution);
            let (closed, last) = (line.first() == line.last(), line.len().saturating_sub(2));
            let facet = move |(k, pair): (usize, &[Vec2])| {
                let middle = 0.5 * (pair[0] + pair[1]);
                let sigma = KINDS.map(|kind| field.across(middle, kind).map(|(_, sigma)| sigma));
                let open = [!closed && k == 0, !closed && k == last];
                Some(Facet { ends: [pair[0], pair[1]], sigma: [sigma[0]?, sigma[1]?], open })
            };
            line.windows(2).enumerate().filter_map(facet).collect::<Vec<_>>()
        });
        Self::new(facets.collect(), field.lattice())
    }

    /// Surfaces of a map on a lattice, from their facets.
    pub fn new(mut facets: Vec<Facet>, lattice: &Lattice) -> Self {
        facets.retain(|facet| facet.ends[0] != facet.ends[1]);
        let places = facets.iter().enumerate().map(|(k, facet)| {
            let [a, b] = facet.ends;
            GeomWithData::new(Line::new(a.into(), b.into()), k)
        });
        let tree = RTree::bulk_load(places.collect());
        let nearby = Nearby::over(&lattice.bounds(), lattice.resolution);
        Self { tree, nearby, facets, resolution: lattice.resolution }
    }

    pub fn facets(&self) -> &[Facet] {
        &self.facets
    }

    /// Bytes it holds in memory, about, once everything was asked about.
    pub fn held_bytes(&self) -> usize {
        250 * self.facets.len() + self.nearby.most_bytes(self.facets.len())
    }

    /// The nearest facet, and how far it is; `None` where the map has no surface.
    pub fn nearest(&self, p: Vec2) -> Option<(&Facet, f64)> {
        let around = self.nearby.around(p, &self.facets, &self.tree);
        let facet = &self.facets[self.nearest_among(p, around.as_ref())?];
        Some((facet, facet.apart(p).norm()))
    }

    /// The nearest surface point; `None` where the map has no surface.
    pub fn foot(&self, p: Vec2, kind: Kind) -> Option<Foot> {
        let around = self.nearby.around(p, &self.facets, &self.tree);
        let own = self.facets[self.nearest_among(p, around.as_ref())?].foot(p, kind, self.resolution);
        let rival = self.rival(p, &own, around.as_ref());
        Some(rival.map_or(own, |facet| own.least_with(&self.facets[facet].foot(p, kind, self.resolution))))
    }

    fn nearest_among(&self, p: Vec2, around: Option<&Surroundings<'_>>) -> Option<usize> {
        match around {
            Some(around) => around.nearest(p, &self.facets),
            None => nearest_of_all(p, &self.facets, &self.tree),
        }
    }

    /// The nearest facet in another direction than a foot's, of those that may be the nearer ones.
    fn rival(&self, p: Vec2, own: &Foot, around: Option<&Surroundings<'_>>) -> Option<usize> {
        let reach = own.distance + 3.0 * own.sigma;
        let mut best: Option<(f64, usize)> = None;
        let consider = |facet: usize| {
            let apart = self.facets[facet].apart(p);
            let squared = apart.norm_squared();
            let nearer = squared <= reach * reach && best.is_none_or(|least| (squared, facet) < least);
            let elsewhere = || match squared > LEAST_LENGTH * LEAST_LENGTH {
                // The cosine below RIVAL, without a root for each.
                true => {
                    let along = apart.dot(&own.away);
                    along < 0.0 || along * along < RIVAL * RIVAL * squared
                }
                // Where the place lies on the facet, that faces across it.
                false => self.facets[facet].normal().dot(&own.away) < RIVAL,
            };
            if nearer && elsewhere() {
                best = Some((squared, facet));
            }
        };
        match around.and_then(|around| around.within(reach)) {
            Some(near) => near.for_each(consider),
            None => within_of_all(p, reach, &self.tree).for_each(consider),
        }
        best.map(|(_, facet)| facet)
    }
}

/// The surface that a beam met, as the facets have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facing {
    pub foot: Vec2,
    /// The unit normal, towards where the beam came from.
    pub normal: Vec2,
    /// How far beyond the facet's line the place lies, along the normal, metres.
    pub across: f64,
}

impl Surfaces {
    /// The nearest facet, within `reach` metres of a place, that faces who looks along `direction`: of a vector map alone,
    /// whose facets know which side of them is free. Looked for nearby first, where it usually is.
    pub fn facing(&self, p: Vec2, direction: Vec2, reach: f64) -> Option<usize> {
        let mut near = (0.5 * self.resolution).min(reach);
        loop {
            let around = AABB::from_corners([p.x - near, p.y - near], [p.x + near, p.y + near]);
            let facets = self.tree.locate_in_envelope_intersecting(around).map(|own| {
                let [a, b] = self.facets[own.data].ends;
                (distance_to_segment(p, a, b), own.data)
            });
            let nearest = facets
                .filter(|(distance, facet)| *distance <= near && self.facets[*facet].normal().dot(&direction) < GRAZING)
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            match nearest {
                Some((_, facet)) => return Some(facet),
                None if near >= reach => return None,
                None => near = (2.0 * near).min(reach),
            }
        }
    }

    /// How a place lies before one of the facets.
    pub fn before(&self, facet: usize, p: Vec2) -> Facing {
        let facet = &self.facets[facet];
        let (foot, normal) = (nearest_on_segment(p, facet.ends[0], facet.ends[1]), facet.normal());
        Facing { foot, normal, across: normal.dot(&(p - foot)) }
    }
}

/// A beam meets a surface against its normal; one that grazes it may have met anything.
const GRAZING: f64 = -0.05;
const KINDS: [Kind; 2] = [Kind::Propagated, Kind::Posterior];
/// Lines may deviate by this share of a cell from how they were traced.
const TOLERANCE: f64 = 0.004;
