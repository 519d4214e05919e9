//! How far it is to space that nobody observed.
//!
//! The evidence's marks that nothing is known of, and that border on one of which something is, are kept in an index,
//! as the squares that they are: the nearest centre need not be that of the nearest square. Beyond the lattice nothing is
//! known. The index is built when it is first asked.

use std::sync::OnceLock;

use rstar::primitives::Rectangle;
use rstar::{PointDistance, RTree};

use crate::geometry::Vec2;
use crate::scan::{Evidence, SUBCELLS, mark_center};
use crate::spline::Lattice;

/// The border of the unobserved.
#[derive(Debug, Clone, Default)]
pub(super) struct Clearance {
    border: OnceLock<RTree<Rectangle<[f64; 2]>>>,
}

impl Clearance {
    /// The distance from a point to the nearest unobserved one, metres; zero where it is unobserved itself, `None`
    /// outside the lattice.
    pub fn to_unseen(&self, lattice: &Lattice, evidence: &Evidence, p: Vec2) -> Option<f64> {
        lattice.locate(p)?;
        if !evidence.at(lattice, p).any() {
            return Some(0.0);
        }
        let area = lattice.bounds();
        let edge = (0..2).map(|axis| (p[axis] - area.min[axis]).min(area.max[axis] - p[axis])).fold(f64::MAX, f64::min);
        let border = self.border.get_or_init(|| border(lattice, evidence));
        let nearest = border.nearest_neighbor(p.into());
        let mark = nearest.map_or(f64::MAX, |square| square.distance_2(&p.into()).sqrt());
        Some(edge.min(mark))
    }
}

fn border(lattice: &Lattice, evidence: &Evidence) -> RTree<Rectangle<[f64; 2]>> {
    let [width, height] = evidence.size();
    let seen = |i: usize, j: usize| evidence.mark(i, j).any();
    let beside_seen = |i: usize, j: usize| {
        (i > 0 && seen(i - 1, j))
            || (j > 0 && seen(i, j - 1))
            || (i + 1 < width && seen(i + 1, j))
            || (j + 1 < height && seen(i, j + 1))
    };
    let marks = (0..width * height).map(|k| (k % width, k / width));
    let unseen = marks.filter(|&(i, j)| !seen(i, j) && beside_seen(i, j));
    let half = Vec2::from_element(0.5 * lattice.resolution / SUBCELLS as f64);
    let square = |(i, j)| {
        let center = mark_center(lattice, i, j);
        Rectangle::from_corners((center - half).into(), (center + half).into())
    };
    RTree::bulk_load(unseen.map(square).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against every unobserved mark of the lattice, one by one.
    #[test]
    fn the_nearest_unobserved_square_is_the_nearest_of_all() {
        let lattice = Lattice { origin: [-1.0, 2.0], resolution: 0.5, cells: [9, 7] };
        let [width, height] = [9 * SUBCELLS, 7 * SUBCELLS];
        let marks: Vec<u8> = (0..width * height).map(|k| u8::from((k * k + k / width) % 7 != 3)).collect();
        let evidence = Evidence::from_marks(&lattice, marks).unwrap();
        let (clearance, side) = (Clearance::default(), 0.5 / SUBCELLS as f64);
        let area = lattice.bounds();
        for k in 0..2000 {
            let share = |by: f64| (f64::from(k) * by).fract();
            let p = Vec2::new(area.min[0] + 4.5 * share(0.618_034), area.min[1] + 3.5 * share(0.414_214));
            let mut least = (0..2).map(|a| (p[a] - area.min[a]).min(area.max[a] - p[a])).fold(f64::MAX, f64::min);
            for (i, j) in (0..width * height).map(|k| (k % width, k / width)) {
                let gap = (p - mark_center(&lattice, i, j)).abs() - Vec2::from_element(0.5 * side);
                if !evidence.mark(i, j).any() {
                    least = least.min(gap.sup(&Vec2::zeros()).norm());
                }
            }
            let found = clearance.to_unseen(&lattice, &evidence, p).unwrap();
            assert!((found - least).abs() < 1e-12, "{p:?}: {found} for {least}");
        }
    }
}
