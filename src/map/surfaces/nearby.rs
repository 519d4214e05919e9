//! Which facets can be the nearest ones in a tile of the plane: an index that fills where it is asked.
//!
//! Points come in numbers, close together: a raster's pixels, a fleet's queries, a scan's returns. A search tree answers
//! each from its root. Here the first point of a tile (a square, centre `c`, half diagonal `r`) lists the facets that any
//! point of it can ask for, in the order of their distance from `c`, and the others read that list. From a point `p` a
//! facet at `d` from the centre is at least `d - |p - c|` away, so a search ends where that exceeds what has been found;
//! no facet nearer than `d_0 + 2 r + slack` to the centre is missing, `d_0` the least.
//!
//! Lists are bounded in number: a compact map in the middle of nowhere is all near to every tile. Beyond the bound the
//! tree answers, and the same, whoever asked what before: facets that share an end are equally near, and the first of
//! them is the nearest.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use rstar::RTree;
use rstar::primitives::{GeomWithData, Line};

use super::Facet;
use crate::geometry::{Bounds, Vec2};

/// A tile's side, in cells. Of smaller ones more are filled, of larger ones the lists are longer: between one and two
/// cells 100,000 points take the same time.
const SIDE: f64 = 1.5;
/// How far beyond the nearest facet a tile's list reaches at least, in cells, as seen from any of its points. Farther is
/// asked at a surface's end alone, and of the tree.
const SLACK: f64 = 0.5;
/// Distances from the centre are kept as f32, a little short.
const SHORT: f64 = 1.0 - 1e-6;
/// More tiles than this are larger ones.
const MOST_TILES: f64 = 1e6;

/// A facet is in so many lists, on the average, at most: in 26 of Intel's map.
const MOST_LISTED: usize = 40;
/// The tree rounds distances in its own way.
const A_LITTLE: f64 = 1.0 + 1e-9;

pub(super) type Tree = RTree<GeomWithData<Line<[f64; 2]>, usize>>;

/// A facet, and its distance from the tile's centre, metres.
#[derive(Debug, Clone, Copy)]
struct Listed {
    from_center: f32,
    facet: u32,
}

/// The facets that matter in a tile.
#[derive(Debug, Clone)]
struct Tile {
    /// Nearest to the centre first.
    listed: Box<[Listed]>,
    /// No facet is missing that is nearer to the centre, metres.
    complete: f64,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Nearby {
    origin: Vec2,
    /// Metres.
    side: f64,
    slack: f64,
    size: [usize; 2],
    tiles: Box<[OnceLock<Tile>]>,
    /// Facets in all lists so far.
    listed: AtomicUsize,
}

/// What a tile knows of a point's surroundings.
pub(super) struct Surroundings<'a> {
    tile: &'a Tile,
    /// The point's distance from the tile's centre, metres.
    off_center: f64,
}

impl Nearby {
    /// An index, empty yet, of places within bounds. `resolution` is the lattice's.
    pub fn over(bounds: &Bounds, resolution: f64) -> Self {
        let [width, height] = bounds.size();
        let side = (SIDE * resolution).max((width * height / MOST_TILES).sqrt());
        let size = [width, height].map(|length| (length / side).ceil().max(1.0) as usize);
        let tiles = (0..size[0] * size[1]).map(|_| OnceLock::new()).collect();
        Self { origin: bounds.min.into(), side, slack: SLACK * resolution, size, tiles, listed: AtomicUsize::new(0) }
    }

    /// Bytes at the most, of so many facets: the tiles, and all of their lists.
    pub fn most_bytes(&self, facets: usize) -> usize {
        size_of_val(&*self.tiles) + MOST_LISTED * facets * size_of::<Listed>()
    }

    /// What is near a point; `None` outside the bounds, and where there are lists enough.
    pub fn around(&self, p: Vec2, facets: &[Facet], tree: &Tree) -> Option<Surroundings<'_>> {
        let at = (p - self.origin) / self.side;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        let [i, j] = [inside.then_some(at.x as usize)?, at.y as usize];
        let center = self.origin + Vec2::new(i as f64 + 0.5, j as f64 + 0.5) * self.side;
        let place = &self.tiles[i + j * self.size[0]];
        let tile = match place.get() {
            Some(tile) => tile,
            None if self.listed.load(Ordering::Relaxed) >= MOST_LISTED * facets.len() => return None,
            None => place.get_or_init(|| self.list(center, facets, tree)),
        };
        Some(Surroundings { tile, off_center: (p - center).norm() })
    }

    fn list(&self, center: Vec2, facets: &[Facet], tree: &Tree) -> Tile {
        let least = tree.nearest_neighbor_with_distance_2(center.into()).map_or(0.0, |(_, squared)| squared.sqrt());
        let complete = least + std::f64::consts::SQRT_2 * self.side + self.slack;
        let mut listed: Vec<Listed> = tree
            .locate_within_distance(center.into(), complete * complete)
            .map(|own| Listed {
                from_center: (facets[own.data].apart(center).norm() * SHORT) as f32,
                facet: own.data as u32,
            })
            .collect();
        listed.sort_unstable_by(|a, b| a.from_center.total_cmp(&b.from_center).then(a.facet.cmp(&b.facet)));
        self.listed.fetch_add(listed.len(), Ordering::Relaxed);
        Tile { listed: listed.into(), complete: complete * SHORT }
    }
}

/// The nearest of all facets, by the tree; of several the first.
pub(super) fn nearest_of_all(p: Vec2, facets: &[Facet], tree: &Tree) -> Option<usize> {
    let (_, least) = tree.nearest_neighbor_with_distance_2(p.into())?;
    let near = within_of_all(p, least.sqrt(), tree).map(|facet| (facets[facet].apart(p).norm_squared(), facet));
    near.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|(_, facet)| facet)
}

/// The facets within a distance of a point, and any that are a little farther, by the tree.
pub(super) fn within_of_all(p: Vec2, distance: f64, tree: &Tree) -> impl Iterator<Item = usize> + '_ {
    // A place on a facet is at no distance from it, give or take a rounding.
    let reach = A_LITTLE * distance + 1e-12;
    tree.locate_within_distance(p.into(), reach * reach).map(|own| own.data)
}

impl Surroundings<'_> {
    /// The nearest facet; of several the first.
    pub fn nearest(&self, p: Vec2, facets: &[Facet]) -> Option<usize> {
        let mut best: Option<(usize, f64)> = None;
        let mut reach = f64::INFINITY;
        for own in &self.tile.listed {
            if f64::from(own.from_center) > reach {
                break;
            }
            let (facet, squared) = (own.facet as usize, facets[own.facet as usize].apart(p).norm_squared());
            if best.is_none_or(|(first, least)| squared < least || (squared == least && facet < first)) {
                best = Some((facet, squared));
                reach = squared.sqrt() + self.off_center;
            }
        }
        best.map(|(facet, _)| facet)
    }

    /// The facets that may lie within a distance of the point, a few beyond it among them; `None` where not all of them are known.
    pub fn within(&self, distance: f64) -> Option<impl Iterator<Item = usize> + '_> {
        let reach = distance + self.off_center;
        (reach <= self.tile.complete).then(|| {
            let near = self.tile.listed.iter().take_while(move |own| f64::from(own.from_center) <= reach);
            near.map(|own| own.facet as usize)
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Foot, RIVAL, Surfaces};
    use super::*;
    use crate::spline::Lattice;
    use crate::uncertainty::Kind;

    const RESOLUTION: f64 = 0.25;

    fn lattice() -> Lattice {
        Lattice { origin: [-1.0, 2.0], resolution: RESOLUTION, cells: [17, 13] }
    }

    /// What [`Surfaces::foot`] says, from all facets one by one.
    fn slow_foot(facets: &[Facet], p: Vec2) -> Foot {
        let first = |kept: &dyn Fn(&Foot) -> bool| {
            let feet =
                facets.iter().map(|own| (own.apart(p).norm_squared(), own.foot(p, Kind::Propagated, RESOLUTION)));
            feet.filter(|own| kept(&own.1)).reduce(|best, own| if own.0 < best.0 { own } else { best })
        };
        let (_, own) = first(&|_| true).unwrap();
        let reach = own.distance + 3.0 * own.sigma;
        let rival = first(&|foot| foot.distance <= reach && foot.away.dot(&own.away) < RIVAL);
        rival.map_or(own, |(_, rival)| own.least_with(&rival))
    }

    /// A line of a few facets: neighbours share an end.
    fn line() -> impl Strategy<Value = Vec<Facet>> {
        let step = ((-0.4..0.4, -0.4..0.4), 0.001..0.3, any::<[bool; 2]>());
        ((-3.0..5.5, 0.0..7.0), prop::collection::vec(step, 1..8)).prop_map(|((x, y), steps)| {
            let mut end = Vec2::new(x, y);
            let facets = steps.into_iter().map(|((dx, dy), sigma, open)| {
                let start = end;
                end += Vec2::new(dx, dy);
                Facet { ends: [start, end], sigma: [sigma, 2.0 * sigma], open }
            });
            facets.collect()
        })
    }

    proptest! {
        /// And the same, whether there are lists or no more may be made.
        #[test]
        fn a_foot_is_that_of_all_facets_one_by_one(
            lines in prop::collection::vec(line(), 1..8),
            points in prop::collection::vec((-2.0..4.5, 1.0..6.5), 1..40),
            beside in prop::collection::vec((0..64usize, -0.3..0.3), 1..20),
        ) {
            let facets = lines.concat();
            let [listing, full] = [0, usize::MAX].map(|listed| {
                let surfaces = Surfaces::new(facets.clone(), &lattice());
                surfaces.nearby.listed.store(listed, Ordering::Relaxed);
                surfaces
            });
            // Where two facets meet both are equally near.
            let beside = beside.into_iter().map(|(k, off)| {
                let own = &facets[k % facets.len()];
                own.ends[1] + own.normal() * off
            });
            for p in points.into_iter().map(|(x, y)| Vec2::new(x, y)).chain(beside) {
                let slow = slow_foot(&facets, p);
                for surfaces in [&listing, &full] {
                    let fast = surfaces.foot(p, Kind::Propagated).unwrap();
                    prop_assert!((fast.distance - slow.distance).abs() <= 1e-15 && (fast.point - slow.point).norm() < 1e-9);
                    prop_assert!((fast.sigma - slow.sigma).abs() <= 1e-12, "{:?} {:?}", fast, slow);
                    prop_assert_eq!(surfaces.nearest(p).unwrap().1, slow.distance);
                }
            }
        }
    }

    #[test]
    fn a_map_without_surfaces_has_no_foot() {
        let surfaces = Surfaces::new(Vec::new(), &lattice());
        assert_eq!(surfaces.foot(Vec2::new(0.0, 3.0), Kind::Propagated), None);
    }
}
