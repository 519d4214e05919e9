//! How far it is to space that nobody observed.
//!
//! The evidence's marks that nothing is known of, and that border on one of which something is, are kept in an index;
//! beyond the lattice nothing is known. The index is built when it is first asked.

use std::sync::OnceLock;

use rstar::RTree;

use crate::geometry::Vec2;
use crate::scan::{Evidence, SUBCELLS, mark_center};
use crate::spline::Lattice;

/// The border of the unobserved.
#[derive(Debug, Clone, Default)]
pub(super) struct Clearance {
    border: OnceLock<RTree<[f64; 2]>>,
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
        let half = Vec2::from_element(0.5 * lattice.resolution / SUBCELLS as f64);
        let nearest = border.nearest_neighbor(p.into());
        // From the mark's square, not its centre.
        let mark = nearest.map_or(f64::MAX, |c| ((p - Vec2::from(*c)).abs() - half).sup(&Vec2::zeros()).norm());
        Some(edge.min(mark))
    }
}

fn border(lattice: &Lattice, evidence: &Evidence) -> RTree<[f64; 2]> {
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
    RTree::bulk_load(unseen.map(|(i, j)| mark_center(lattice, i, j).into()).collect())
}
