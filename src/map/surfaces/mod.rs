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
pub(crate) mod level;
pub(crate) mod lines;
pub(crate) mod samples;
mod simple;
mod walls;

use rstar::primitives::{GeomWithData, Line};
use rstar::{AABB, RTree};

use super::Field;
use super::query::normal_cdf;
use crate::fit::Surfels;
use crate::geometry::{Vec2, distance_to_segment, nearest_on_segment, share_on_segment, turned};
use crate::uncertainty::Kind;

/// Where a surface ends is known to this many cells, where it turns away to that many, and how far it strays from its
/// facets (standard deviations, from two buildings: `docs/vector.md`).
const END: f64 = 0.4;
const TURN: f64 = 0.25;
pub(crate) const STRAY: f64 = 0.03;
/// Surfaces whose directions have a cosine below this are different ones.
const RIVAL: f64 = 0.5;

/// A straight piece of surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Metres.
    pub ends: [Vec2; 2],
    /// The standard deviation of its place across itself, metres: propagated, posterior.
    pub sigma: [f64; 2],
    /// Whether the surface ends at either end.
    pub open: [bool; 2],
}

/// A map's facets and an index over them; see the module.
#[derive(Debug, Clone)]
pub struct Surfaces {
    facets: Vec<Facet>,
    tree: RTree<GeomWithData<Line<[f64; 2]>, usize>>,
    /// The lattice's, metres.
    resolution: f64,
}

/// The surface point nearest to a place, and what is known of the distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    pub point: Vec2,
    /// Metres.
    pub distance: f64,
    /// Its standard deviation, metres.
    pub sigma: f64,
    /// The unit vector away from the surface; across it where the place lies on it.
    pub away: Vec2,
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
        Self::new(facets.collect(), field.lattice().resolution)
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
        Self::new(facets.collect(), resolution)
    }

    /// Surfaces from their facets. `resolution` is the lattice's.
    pub fn new(mut facets: Vec<Facet>, resolution: f64) -> Self {
        facets.retain(|facet| facet.ends[0] != facet.ends[1]);
        let places = facets.iter().enumerate().map(|(k, facet)| {
            let [a, b] = facet.ends;
            GeomWithData::new(Line::new(a.into(), b.into()), k)
        });
        Self { tree: RTree::bulk_load(places.collect()), facets, resolution }
    }

    pub fn facets(&self) -> &[Facet] {
        &self.facets
    }

    /// The nearest facet, and how far it is; `None` where the map has no surface.
    pub fn nearest(&self, p: Vec2) -> Option<(&Facet, f64)> {
        let facet = &self.facets[self.tree.nearest_neighbor(p.into())?.data];
        let [a, b] = facet.ends;
        Some((facet, distance_to_segment(p, a, b)))
    }

    /// The nearest surface point; `None` where the map has no surface.
    pub fn foot(&self, p: Vec2, kind: Kind) -> Option<Foot> {
        let nearest = self.tree.nearest_neighbor(p.into())?;
        let own = self.facets[nearest.data].foot(p, kind, self.resolution);
        let reach = own.distance + 3.0 * own.sigma;
        let rival = self
            .tree
            .locate_within_distance(p.into(), reach * reach)
            .map(|other| self.facets[other.data].foot(p, kind, self.resolution))
            .filter(|other| other.away.dot(&own.away) < RIVAL)
            .min_by(|a, b| a.distance.total_cmp(&b.distance));
        Some(rival.map_or(own, |rival| own.least_with(&rival)))
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

impl Facet {
    pub fn sigma(&self, kind: Kind) -> f64 {
        self.sigma[usize::from(kind == Kind::Posterior)]
    }

    /// The unit normal towards free space, of a vector map's facets: a surfel lies along its normal, which points away from who
    /// saw it, turned by a quarter.
    fn normal(&self) -> Vec2 {
        turned((self.ends[1] - self.ends[0]).normalize())
    }

    fn foot(&self, p: Vec2, kind: Kind, resolution: f64) -> Foot {
        let [a, b] = self.ends;
        let share = share_on_segment(p, a, b);
        let point = a + (b - a) * share;
        let along = (b - a).normalize();
        let distance = (p - point).norm();
        let away = (p - point).try_normalize(1e-9).unwrap_or(turned(along));
        let across = self.sigma(kind).hypot(STRAY * resolution);
        let at_end = (share == 0.0 && self.open[0]) || (share == 1.0 && self.open[1]);
        let tangential = if at_end { END } else { TURN } * resolution;
        let (n, t) = (turned(along).dot(&away), along.dot(&away));
        Foot { point, distance, sigma: (n * across).hypot(t * tangential), away }
    }
}

impl Foot {
    /// The least of two uncertain distances, independent ones (Clark 1961). The place stays the nearer one's.
    fn least_with(&self, other: &Self) -> Self {
        let spread = self.sigma.hypot(other.sigma);
        let gap = (other.distance - self.distance) / spread;
        let density = (-0.5 * gap * gap).exp() / std::f64::consts::TAU.sqrt();
        let below = normal_cdf(gap);
        // Moments about the nearer distance, so that nothing large cancels.
        let farther = other.distance - self.distance;
        let mean = farther * (1.0 - below) - spread * density;
        let second = self.sigma.powi(2) * below + (farther.powi(2) + other.sigma.powi(2)) * (1.0 - below)
            - farther * spread * density;
        Self { sigma: (second - mean * mean).sqrt(), ..*self }
    }
}
