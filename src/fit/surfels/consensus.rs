//! What the patches around one say together: the local line through them, and how far the next ones are along it.
//!
//! The line is Cleveland's LOESS across the surface: weighted least squares with a Gaussian kernel, twice, the second
//! time around the first line's own place and normal.

use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::Patch;
use crate::geometry::{Vec2, turned};

/// The local line's kernel, in cells: its standard deviation, and where it ends.
const KERNEL: f64 = 0.5;
const KERNEL_END: f64 = 1.25;
/// Normals with at least this cosine between them belong to one surface.
const ALIKE: f64 = 0.8;
/// Surfels of one surface farther apart than this many cells leave a gap between them.
const LONGEST_JOIN: f64 = 2.0;

/// All patches, and an index over their centres.
pub(super) struct Neighbourhood<'a> {
    pub patches: &'a [Patch],
    pub tree: RTree<GeomWithData<[f64; 2], usize>>,
    /// The lattice's resolution, metres.
    pub h: f64,
}

/// The local line through a patch's neighbourhood: a point of it near the patch, and its normal.
pub(super) fn consensus(patch: &Patch, around: &Neighbourhood<'_>) -> (Vec2, Vec2) {
    let Neighbourhood { patches, tree, h } = around;
    let (mut anchor, mut normal) = (patch.center, patch.normal);
    for _ in 0..2 {
        let tangent = turned(normal);
        // Weighted sums of 1, t, t^2, s and t s.
        let mut sums = [0.0; 5];
        for near in tree.locate_within_distance(anchor.into(), (KERNEL_END * h).powi(2)) {
            let other = &patches[near.data];
            if other.normal.dot(&normal) < ALIKE {
                continue;
            }
            let apart = other.center - anchor;
            let weight = other.weight * (-apart.norm_squared() / (2.0 * (KERNEL * h).powi(2))).exp();
            let (s, t) = (normal.dot(&apart), tangent.dot(&apart));
            [1.0, t, t * t, s, t * s].iter().zip(&mut sums).for_each(|(term, sum)| *sum += weight * term);
        }
        let [one, t, tt, s, ts] = sums;
        if one <= 0.0 {
            break;
        }
        // A ridge on the slope: a few returns in one place say nothing about direction.
        let spread = tt - t * t / one + one * (0.05 * h).powi(2);
        let slope = (ts - t * s / one) / spread;
        anchor += normal * ((s - slope * t) / one);
        normal = (normal - tangent * slope).normalize();
    }
    // A line through next to nothing may lead anywhere: a consensus far from the patch is none.
    match (anchor - patch.center).norm() <= KERNEL * h {
        true => (anchor, normal),
        false => (patch.center, patch.normal),
    }
}

/// How far the next patch of the same surface is on either side.
pub(super) fn neighbours(anchor: Vec2, normal: Vec2, around: &Neighbourhood<'_>) -> [Option<f64>; 2] {
    let Neighbourhood { patches, tree, h } = around;
    let mut next = [f64::INFINITY; 2];
    for near in tree.locate_within_distance(anchor.into(), (LONGEST_JOIN * h).powi(2)) {
        let other = &patches[near.data];
        let apart = other.center - anchor;
        let t = turned(normal).dot(&apart);
        if other.normal.dot(&normal) >= ALIKE && normal.dot(&apart).abs() <= h.min(0.5 * h + 0.3 * t.abs()) {
            let side = usize::from(t > 0.0);
            if t.abs() > 1e-3 * h {
                next[side] = next[side].min(t.abs());
            }
        }
    }
    next.map(|t| t.is_finite().then_some(t))
}
