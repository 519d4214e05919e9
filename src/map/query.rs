//! What a map says about a point: distance, gradient, their covariance, and whether there is evidence.
//!
//! Value and gradient are linear in the 16 coefficients of the point's cell, so their covariance is a 16 x 16 block of the
//! stored marginals between three basis rows: nothing is solved.

use super::FittedMap;
use crate::geometry::{Cov2, Vec2};
use crate::sparse::CellBlock;
use crate::spline::{Located, dot};
use crate::uncertainty::Kind;

/// The answer at one point of the lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Metres, negative in free space.
    pub distance: f64,
    pub gradient: Vec2,
    /// The standard deviation of the distance, metres.
    pub sigma: f64,
    pub gradient_covariance: Cov2,
    /// Covariance of the distance with each component of the gradient, metres.
    pub distance_gradient_covariance: Vec2,
    /// Whether a beam passed here, or a surface was met within half a cell.
    pub observed: bool,
}

impl FittedMap {
    /// The answer at a point, or `None` outside the lattice.
    pub fn query(&self, p: Vec2, kind: Kind) -> Option<Answer> {
        let at = self.lattice().locate(p)?;
        let row = self.lattice().row(&at);
        let local = self.surface.gather(at.cell);
        let block = self.covariance_at(&at, kind);
        let (on_value, on_x, on_y) = (block.times(&row.value), block.times(&row.dx), block.times(&row.dy));
        let xy = dot(&row.dx, &on_y);
        Some(Answer {
            distance: dot(&row.value, &local),
            gradient: Vec2::new(dot(&row.dx, &local), dot(&row.dy, &local)),
            sigma: dot(&row.value, &on_value).max(0.0).sqrt(),
            gradient_covariance: Cov2::new(dot(&row.dx, &on_x), xy, xy, dot(&row.dy, &on_y)),
            distance_gradient_covariance: Vec2::new(dot(&row.dx, &on_value), dot(&row.dy, &on_value)),
            observed: self.evidence.at(self.lattice(), p).any(),
        })
    }

    /// Distance and its standard deviation, or `None` outside the lattice.
    pub fn distance(&self, p: Vec2, kind: Kind) -> Option<(f64, f64)> {
        let at = self.lattice().locate(p)?;
        let row = self.lattice().row(&at).value;
        let variance = self.marginals.of(kind).cell_form(self.lattice().support(at.cell)[0], &row);
        Some((dot(&row, &self.surface.gather(at.cell)), variance.max(0.0).sqrt()))
    }

    fn covariance_at(&self, at: &Located, kind: Kind) -> CellBlock {
        let first = self.lattice().support(at.cell)[0];
        self.marginals.of(kind).cell(first)
    }
}
