//! What a map says about a point: distance, gradient, their covariance, and whether there is evidence.
//!
//! Value and gradient are linear in the 16 coefficients of the point's cell, so their covariance is a 16 x 16 block of
//! the stored marginals between three basis rows: nothing is solved. What a vector field makes of them:
//! [`super::field`].

use super::FittedMap;
use crate::geometry::{Cov2, Vec2};
use crate::spline::dot;
use crate::uncertainty::Kind;

/// The answer at one point of the lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Metres; a signed distance is negative in free space.
    pub distance: f64,
    pub gradient: Vec2,
    /// The standard deviation of the distance, metres.
    pub sigma: f64,
    pub gradient_covariance: Cov2,
    /// Covariance of the distance with each component of the gradient, metres.
    pub distance_gradient_covariance: Vec2,
    /// From the nearest surface point, with its covariance [xx, xy, yy]: of a vector field.
    pub vector: Option<(Vec2, [f64; 3])>,
}

impl FittedMap {
    /// The answer at a point, or `None` outside the lattice and where no control points are in use.
    pub fn query(&self, p: Vec2, kind: Kind) -> Option<Answer> {
        let at = self.field.locate(p)?;
        let local = self.field.local(&at, kind)?;
        let (row, block) = (&local.row, &local.covariance);
        let (on_value, on_x, on_y) = (block.times(&row.value), block.times(&row.dx), block.times(&row.dy));
        let xy = dot(&row.dx, &on_y);
        let vector = self.field.vector(p).map(|at| at.vector);
        Some(Answer {
            distance: vector.map_or_else(|| dot(&row.value, &local.coefficients), |v| v.norm()),
            gradient: Vec2::new(dot(&row.dx, &local.coefficients), dot(&row.dy, &local.coefficients)),
            sigma: dot(&row.value, &on_value).max(0.0).sqrt(),
            gradient_covariance: Cov2::new(dot(&row.dx, &on_x), xy, xy, dot(&row.dy, &on_y)),
            distance_gradient_covariance: Vec2::new(dot(&row.dx, &on_value), dot(&row.dy, &on_value)),
            vector: vector.zip(self.field.vector_covariance(p, kind)),
        })
    }

    /// Whether a beam passed a point, or a surface was met within half a cell; `None` outside the lattice.
    pub fn observed(&self, p: Vec2) -> Option<bool> {
        self.lattice().locate(p).map(|_| self.evidence.at(self.lattice(), p).any())
    }

    /// Distance and its standard deviation, or `None` outside the lattice and where no control points are in use.
    pub fn distance(&self, p: Vec2, kind: Kind) -> Option<(f64, f64)> {
        self.field.distance(p, kind)
    }
}
