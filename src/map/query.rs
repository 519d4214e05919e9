//! What a map says about a point: distance, gradient, nearest surface, clearance, and whether there is evidence.
//!
//! A signed map's distance is its spline's: value and gradient are linear in the 16 coefficients of the point's cell,
//! so their covariance is a 16 x 16 block of the stored marginals between three basis rows, and nothing is solved. A
//! vector map's is that to its surfaces ([`super::surfaces`]); its vector stays the spline's.

use super::FittedMap;
use crate::fit::Distance;
use crate::geometry::{Cov2, Vec2};
use crate::spline::dot;
use crate::uncertainty::Kind;

/// The answer at one point of the lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// To the nearest surface, metres; a signed distance is negative in free space.
    pub distance: f64,
    pub gradient: Vec2,
    /// The standard deviation of the distance, metres.
    pub sigma: f64,
    /// The surface point that the distance is measured from; of a signed distance see [`FittedMap::nearest`].
    pub nearest: Option<Vec2>,
    /// Covariances of the gradient and with it, of a signed distance.
    pub slopes: Option<SlopeCovariance>,
}

/// How uncertain a gradient is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlopeCovariance {
    pub gradient: Cov2,
    /// Of the distance with each component of the gradient, metres.
    pub with_distance: Vec2,
}

impl FittedMap {
    /// The answer at a point, or `None` outside the lattice and where no control points are in use.
    pub fn query(&self, p: Vec2, kind: Kind) -> Option<Answer> {
        let at = self.field.locate(p)?;
        if self.field.distance() == Distance::Vector {
            let foot = self.surfaces.foot(p, kind)?;
            return Some(Answer {
                distance: foot.distance,
                gradient: foot.away,
                sigma: foot.sigma,
                nearest: Some(foot.point),
                slopes: None,
            });
        }
        let local = self.field.local(&at, kind);
        let (row, block) = (&local.row, &local.covariance);
        let (on_value, on_x, on_y) = (block.times(&row.value), block.times(&row.dx), block.times(&row.dy));
        let xy = dot(&row.dx, &on_y);
        Some(Answer {
            distance: dot(&row.value, &local.coefficients),
            gradient: Vec2::new(dot(&row.dx, &local.coefficients), dot(&row.dy, &local.coefficients)),
            sigma: dot(&row.value, &on_value).sqrt(),
            nearest: None,
            slopes: Some(SlopeCovariance {
                gradient: Cov2::new(dot(&row.dx, &on_x), xy, xy, dot(&row.dy, &on_y)),
                with_distance: Vec2::new(dot(&row.dx, &on_value), dot(&row.dy, &on_value)),
            }),
        })
    }

    /// The value of a vector field's spline: from the nearest surface point. `None` as above, and of a signed field.
    pub fn vector(&self, p: Vec2) -> Option<Vec2> {
        self.field.vector(p).map(|at| at.vector)
    }

    /// Its covariance [xx, xy, yy], likewise.
    pub fn vector_covariance(&self, p: Vec2, kind: Kind) -> Option<[f64; 3]> {
        self.field.vector_covariance(p, kind)
    }

    /// Distance and its standard deviation, or `None` outside the lattice and where no control points are in use.
    pub fn distance(&self, p: Vec2, kind: Kind) -> Option<(f64, f64)> {
        match self.field.distance() {
            Distance::Signed => self.field.across(p, kind),
            Distance::Vector => {
                let _ = self.field.locate(p)?;
                self.surfaces.foot(p, kind).map(|foot| (foot.distance, foot.sigma))
            }
        }
    }

    /// The distance alone, likewise.
    pub fn distance_alone(&self, p: Vec2) -> Option<f64> {
        match self.field.distance() {
            Distance::Signed => self.field.value(p),
            Distance::Vector => self.distance_and_gradient(p).map(|(distance, _)| distance),
        }
    }

    /// Distance and its gradient, likewise.
    pub fn distance_and_gradient(&self, p: Vec2) -> Option<(f64, Vec2)> {
        match self.field.distance() {
            Distance::Signed => self.field.slope(p),
            Distance::Vector => {
                let _ = self.field.locate(p)?;
                self.surfaces.foot(p, Kind::Propagated).map(|foot| (foot.distance, foot.away))
            }
        }
    }

    /// The surface point that the distance is measured from; `None` as above, and where the map has no surface.
    pub fn nearest(&self, p: Vec2) -> Option<Vec2> {
        let _ = self.field.locate(p)?;
        self.surfaces.foot(p, Kind::Propagated).map(|foot| foot.point)
    }

    /// The unsigned distance to the nearest surface or to space that nobody observed, whichever is nearer; `None`
    /// outside the lattice.
    pub fn clearance(&self, p: Vec2) -> Option<f64> {
        let unseen = self.clearance.to_unseen(self.lattice(), &self.evidence, p)?;
        let surface = self.surfaces.foot(p, Kind::Propagated).map_or(f64::INFINITY, |foot| foot.distance);
        Some(unseen.min(surface))
    }

    /// Whether a beam passed a point, or a surface was met within half a cell; `None` outside the lattice.
    pub fn observed(&self, p: Vec2) -> Option<bool> {
        self.lattice().locate(p).map(|_| self.evidence.at(self.lattice(), p).any())
    }
}

/// The standard normal distribution function, to 1.5e-7 (Abramowitz and Stegun 7.1.26): a hundredth is what a cell of
/// a grid shows.
pub(crate) fn normal_cdf(z: f64) -> f64 {
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series = ((((1.061_405_429 * t - 1.453_152_027) * t) + 1.421_413_741) * t - 0.284_496_736) * t + 0.254_829_592;
    let erf = 1.0 - series * t * (-x * x).exp();
    0.5 * (1.0 + erf.copysign(z))
}
