//! Short straight pieces of surface, and the distance to one; `surfaces` has the variance's equation.

use crate::geometry::{Vec2, nearest_on_segment, share_on_segment, turned};
use crate::map::query::normal_cdf;
use crate::uncertainty::Kind;

/// Where a surface ends is known to this many cells, where it turns away to that many, and how far it strays from its
/// facets (standard deviations, from two buildings: `docs/vector.md`).
const END: f64 = 0.4;
const TURN: f64 = 0.25;
pub(crate) const STRAY: f64 = 0.03;
/// What is shorter has no direction, metres.
pub(super) const LEAST_LENGTH: f64 = 1e-9;

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

impl Facet {
    pub fn sigma(&self, kind: Kind) -> f64 {
        self.sigma[usize::from(kind == Kind::Posterior)]
    }

    /// The unit normal. Of a vector map's facets towards free space: a surfel lies along its normal, which points away
    /// from who saw it, turned by a quarter.
    pub(super) fn normal(&self) -> Vec2 {
        turned((self.ends[1] - self.ends[0]).normalize())
    }

    /// A place as seen from the facet's point that is nearest to it.
    pub(super) fn apart(&self, p: Vec2) -> Vec2 {
        p - nearest_on_segment(p, self.ends[0], self.ends[1])
    }

    pub(super) fn foot(&self, p: Vec2, kind: Kind, resolution: f64) -> Foot {
        let [a, b] = self.ends;
        let share = share_on_segment(p, a, b);
        let point = a + (b - a) * share;
        let along = (b - a).normalize();
        let distance = (p - point).norm();
        let away = (p - point).try_normalize(LEAST_LENGTH).unwrap_or(turned(along));
        let across2 = self.sigma(kind).powi(2) + (STRAY * resolution).powi(2);
        let at_end = (share == 0.0 && self.open[0]) || (share == 1.0 && self.open[1]);
        let tangential = if at_end { END } else { TURN } * resolution;
        let (n, t) = (turned(along).dot(&away), along.dot(&away));
        Foot { point, distance, sigma: (n * n * across2 + (t * tangential).powi(2)).sqrt(), away }
    }
}

impl Foot {
    /// The least of two uncertain distances, independent ones (Clark 1961). The place stays the nearer one's.
    pub(super) fn least_with(&self, other: &Self) -> Self {
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
