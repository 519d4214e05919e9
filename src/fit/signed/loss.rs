//! Losses as scalar functions of a few local quantities, with gradient and Hessian.
//!
//! The chain rule from these quantities to control points and poses is the same for all losses and lives in
//! [`super::chain`].

use nalgebra::{SMatrix, SVector};

/// Which second derivatives a step wants: the Hessian itself, its positive semi-definite stand-in (for the Eikonal loss
/// its projection, point by point; for returns Gauss-Newton's), or a mean of the two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curvature {
    convex: f64,
}

impl Curvature {
    pub const EXACT: Self = Self { convex: 0.0 };
    pub const CONVEX: Self = Self { convex: 1.0 };

    /// The mean with such a share of the stand-in, in [0, 1].
    pub fn without_concavity(share: f64) -> Self {
        Self { convex: share }
    }

    /// The exact Hessian's share in what has no sign of its own.
    pub fn exact_share(&self) -> f64 {
        1.0 - self.convex
    }

    /// An eigenvalue as this curvature has it.
    pub fn of(&self, eigenvalue: f64) -> f64 {
        if eigenvalue < 0.0 { self.exact_share() * eigenvalue } else { eigenvalue }
    }
}

/// A function's value, gradient and Hessian in `K` local quantities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalJet<const K: usize> {
    pub value: f64,
    pub gradient: SVector<f64, K>,
    pub hessian: SMatrix<f64, K, K>,
}
