//! What differs between two maps of one frame beyond what both maps' uncertainty explains.
//!
//! A surface has *appeared* where the new map has one and the old one saw free space on both of its sides, and *vanished*
//! the other way round. Every surface is asked piece by piece: of a piece at `q` in one map,
//!
//! ```text
//! z = (d - b) / sqrt(sigma_1^2 + sigma_2^2)
//! ```
//!
//! with `d` the distance from `q` to the nearest surface of the other map, `sigma_1` and `sigma_2` both surfaces' standard
//! deviations across themselves, how far a surface strays from its facets included, and `b` what a lattice cannot follow: a
//! cell's half, by which two fits of the same corner or jamb may differ whatever their scans say. The other map has to have seen free space all around `q`, to three
//! quarters of a cell: beams went *through* where the surface is, so it did not merely lie in a shadow.
//!
//! Many pieces are asked, so what one of them shows by chance is not what the map shows by chance. A spline's neighbouring
//! pieces err together, over about two cells; `n` is the length of all surfaces that could have been found changed, in two
//! cells each, of both maps, and a piece counts where `n P(Z > z) <= 1 - probability` (Bonferroni over the effective pieces:
//! the chance that an unchanged pair of maps shows anything at all). Pieces nearer than a cell to each other are one
//! change; one that is shorter than a cell is none, whatever its probability: a lattice shows nothing smaller.
//!
//! Normal tails say nothing about one in a million, so no change is more probable than [`MOST_PROBABLE`].

use ::contour::Error;
use geo_types::{Coord, LineString, Polygon};
use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::geometry::Vec2;
use crate::map::{FittedMap, STRAY, Samples};
use crate::scan::{SUBCELLS, Seen};

/// No change is more probable.
pub const MOST_PROBABLE: f64 = 0.999_999;
/// `b`, cells.
const BLIND: f64 = 0.5;
/// The other map saw free space this far around a piece, in cells.
const THROUGH: f64 = 0.75;
/// The share of the marks there that are free.
const MOSTLY: f64 = 0.95;
/// Pieces a cell.
const PIECES: f64 = 4.0;
/// A spline's pieces err together over so many cells.
const CORRELATED: f64 = 2.0;
/// Pieces nearer than this many cells are one change, and one that is shorter than that is none.
const LINK: f64 = 1.0;
const SHORTEST: f64 = 1.0;
/// A change reaches this many cells around its pieces, traced with so many samples a cell.
const REACH: f64 = 0.5;
const SAMPLES: f64 = 8.0;

/// What became of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChangeRole {
    /// It is where there was free space.
    Appeared,
    /// Free space is where it was.
    Vanished,
}

impl ChangeRole {
    /// The name that the contract gives it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Appeared => "appeared",
            Self::Vanished => "vanished",
        }
    }
}

/// One change.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    pub role: ChangeRole,
    /// That it is one, with all that was asked taken into account.
    pub probability: f64,
    /// Square metres.
    pub area: f64,
    /// Around the surfaces, metres in the maps' frame; counter-clockwise.
    pub polygon: Polygon<f64>,
}

/// A piece of one map's surface as the other map sees it.
struct Piece {
    place: Vec2,
    z: f64,
}

/// What differs between two maps, in the order of where it lies. `probability` is that no change at all is shown of two
/// maps of an unchanged world.
pub fn changes(new: &FittedMap, old: &FittedMap, probability: f64) -> Result<Vec<Change>, Error> {
    let (appeared, length) = pieces(new, old);
    let (vanished, other_length) = pieces(old, new);
    let cell = new.lattice().resolution.max(old.lattice().resolution);
    let asked = ((length + other_length) / (CORRELATED * cell)).max(1.0);
    let chance = |z: f64| asked * upper_tail(z);
    let mut found = Vec::new();
    for (role, pieces) in [(ChangeRole::Appeared, appeared), (ChangeRole::Vanished, vanished)] {
        let shown: Vec<Piece> = pieces.into_iter().filter(|piece| chance(piece.z) <= 1.0 - probability).collect();
        for cluster in clusters(&shown, LINK * cell) {
            if cluster.len() as f64 * cell / PIECES < SHORTEST * cell {
                continue;
            }
            let strongest = cluster.iter().map(|piece| piece.z).fold(0.0, f64::max);
            let places: Vec<Vec2> = cluster.iter().map(|piece| piece.place).collect();
            let Some(polygon) = outline(&places, cell)? else { continue };
            let probability = (1.0 - chance(strongest)).min(MOST_PROBABLE);
            found.push(Change { role, probability, area: area(polygon.exterior()), polygon });
        }
    }
    Ok(found)
}

/// The pieces of `own`'s surfaces that the other map knows free space around, and the length of all that it knows
/// anything about, metres.
fn pieces(own: &FittedMap, other: &FittedMap) -> (Vec<Piece>, f64) {
    let cell = own.lattice().resolution.max(other.lattice().resolution);
    let (mut pieces, mut length) = (Vec::new(), 0.0);
    for facet in own.surfaces.facets() {
        let [a, b] = facet.ends;
        let own_length = (b - a).norm();
        let count = (own_length * PIECES / cell).ceil().max(1.0) as usize;
        for k in 0..count {
            let place = a + (b - a) * ((k as f64 + 0.5) / count as f64);
            if !seen(own, place).surface || !seen(other, place).any() {
                continue;
            }
            length += own_length / count as f64;
            if !went_through(other, place, THROUGH * cell) {
                continue;
            }
            if let Some(z) = apart(facet.sigma, other, place, BLIND * cell) {
                pieces.push(Piece { place, z });
            }
        }
    }
    (thinned(pieces, cell / PIECES), length)
}

fn seen(map: &FittedMap, p: Vec2) -> Seen {
    map.evidence.at(map.lattice(), p)
}

/// Whether beams passed all around a place, and met nothing there.
fn went_through(map: &FittedMap, p: Vec2, radius: f64) -> bool {
    let step = map.lattice().resolution / SUBCELLS as f64;
    let reach = (radius / step).ceil() as i64;
    let around = (-reach..=reach).flat_map(|i| (-reach..=reach).map(move |j| Vec2::new(i as f64, j as f64) * step));
    let (mut all, mut free) = (0.0, 0.0);
    for offset in around.filter(|offset| offset.norm() <= radius) {
        all += 1.0;
        free += f64::from(u8::from(seen(map, p + offset).free));
    }
    let here = seen(map, p);
    here.free && !here.surface && free >= MOSTLY * all
}

/// `z`, by the larger of both kinds' standard deviations; one map's surface at `p` with `sigma`. A map without any surface is
/// as far away as it is large.
fn apart(sigma: [f64; 2], other: &FittedMap, p: Vec2, blind: f64) -> Option<f64> {
    let own = sigma[0].max(sigma[1]);
    let (distance, theirs) = match other.surfaces.nearest(p) {
        Some((facet, distance)) => (distance, facet.sigma[0].max(facet.sigma[1])),
        None => {
            let [width, height] = other.lattice().bounds().size();
            (width.hypot(height), own)
        }
    };
    let stray = STRAY * other.lattice().resolution;
    let z = (distance - blind) / own.hypot(theirs).hypot(std::f64::consts::SQRT_2 * stray);
    (z > 0.0).then_some(z)
}

/// Pieces such that one stands for a length: of two surfels over one another, one counts.
fn thinned(pieces: Vec<Piece>, side: f64) -> Vec<Piece> {
    let key = |p: Vec2| ((p.y / side).floor() as i64, (p.x / side).floor() as i64);
    let mut keyed: Vec<((i64, i64), Piece)> = pieces.into_iter().map(|piece| (key(piece.place), piece)).collect();
    keyed.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.z.total_cmp(&a.1.z)));
    keyed.dedup_by_key(|(key, _)| *key);
    keyed.into_iter().map(|(_, piece)| piece).collect()
}

/// Pieces that hang together, by chains of neighbours nearer than `link`.
fn clusters(pieces: &[Piece], link: f64) -> Vec<Vec<&Piece>> {
    let places = pieces.iter().enumerate().map(|(k, piece)| GeomWithData::new([piece.place.x, piece.place.y], k));
    let tree = RTree::bulk_load(places.collect());
    let mut taken = vec![false; pieces.len()];
    let mut clusters = Vec::new();
    for first in 0..pieces.len() {
        if std::mem::replace(&mut taken[first], true) {
            continue;
        }
        let (mut cluster, mut next) = (Vec::new(), vec![first]);
        while let Some(k) = next.pop() {
            cluster.push(&pieces[k]);
            for near in tree.locate_within_distance(pieces[k].place.into(), link * link) {
                if !std::mem::replace(&mut taken[near.data], true) {
                    next.push(near.data);
                }
            }
        }
        clusters.push(cluster);
    }
    clusters
}

/// The outline of what lies within [`REACH`] cells of the places, without holes: what new surfaces close in was free
/// space, too.
fn outline(places: &[Vec2], cell: f64) -> Result<Option<Polygon<f64>>, Error> {
    let (step, reach) = (cell / SAMPLES, REACH * cell);
    let around = Vec2::from_element(reach + 2.0 * step);
    let (low, high) = places.iter().fold((places[0], places[0]), |(low, high), p| (low.inf(p), high.sup(p)));
    let (low, high) = (low - around, high + around);
    let size = [0, 1].map(|axis: usize| ((high[axis] - low[axis]) / step).ceil() as usize + 1);
    let samples = Samples { origin: low.into(), step, size };
    let tree = RTree::bulk_load(places.iter().map(|p| [p.x, p.y]).collect());
    let far = 2.0 * reach;
    let values = samples.collect(|p| {
        reach - tree.nearest_neighbor_with_distance_2([p.x, p.y]).map_or(far, |(_, d2)| d2.sqrt().min(far))
    });
    let traced = samples.tracer().contours(&values, &[0.0])?;
    let polygons = traced.iter().flat_map(|level| &level.geometry().0);
    let rings = polygons.map(|polygon| {
        let corners = polygon.exterior().0.iter().map(|&p| samples.to_world(p));
        LineString(corners.map(|p| Coord { x: p.x, y: p.y }).collect())
    });
    let largest = rings.max_by(|a: &LineString<f64>, b| area(a).total_cmp(&area(b)));
    Ok(largest.map(|mut ring| {
        if signed_area(&ring) < 0.0 {
            ring.0.reverse();
        }
        Polygon::new(ring, Vec::new())
    }))
}

/// The chance that a standard normal number exceeds `z`, to eight digits for `z` of 1 and more, where it matters: Laplace's
/// continued fraction.
fn upper_tail(z: f64) -> f64 {
    if z < 1.0 {
        return 1.0;
    }
    let fraction = (1..=80).rev().fold(z, |below, k| z + f64::from(k) / below);
    (-0.5 * z * z).exp() / (std::f64::consts::TAU.sqrt() * fraction)
}

fn signed_area(ring: &LineString<f64>) -> f64 {
    0.5 * ring.0.windows(2).map(|e| e[0].x * e[1].y - e[1].x * e[0].y).sum::<f64>()
}

fn area(ring: &LineString<f64>) -> f64 {
    signed_area(ring).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(x: f64, y: f64) -> Piece {
        Piece { place: Vec2::new(x, y), z: 5.0 }
    }

    #[test]
    fn tails_are_those_of_tables() {
        for (z, exact) in [(1.0, 0.158_655_254), (2.0, 0.022_750_132), (4.0, 3.167_124_2e-5), (6.0, 9.865_876_5e-10)] {
            assert!((upper_tail(z) / exact - 1.0).abs() < 1e-7, "{z}: {}", upper_tail(z));
        }
    }

    #[test]
    fn what_hangs_together_is_one_change() {
        let pieces = [piece(0.0, 0.0), piece(5.0, 0.0), piece(0.15, 0.0), piece(5.0, 0.15), piece(0.3, 0.0)];
        let mut sizes: Vec<usize> = clusters(&pieces, 0.2).iter().map(Vec::len).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [2, 3]);
    }

    #[test]
    fn an_outline_is_a_strip_around_a_line_and_has_no_holes() {
        let line: Vec<Vec2> = (0..=20).map(|k| Vec2::new(0.05 * f64::from(k), 2.0)).collect();
        let strip = outline(&line, 0.2).unwrap().unwrap();
        let exact = 1.0 * 0.2 + std::f64::consts::PI * 0.01;
        assert!((area(strip.exterior()) / exact - 1.0).abs() < 0.05, "{}", area(strip.exterior()));
        assert!(signed_area(strip.exterior()) > 0.0);
        let ring: Vec<Vec2> =
            (0..40).map(|k| f64::from(k) / 40.0 * std::f64::consts::TAU).map(|a| Vec2::new(a.cos(), a.sin())).collect();
        let disc = outline(&ring, 0.2).unwrap().unwrap();
        assert!((area(disc.exterior()) / (std::f64::consts::PI * 1.21) - 1.0).abs() < 0.05);
        assert!(disc.interiors().is_empty());
    }
}
