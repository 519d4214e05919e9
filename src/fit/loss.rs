//! Losses as scalar functions of a few local quantities, with gradient and Hessian.
//!
//! The chain rule from these quantities to control points and poses is the same for all losses and lives in
//! [`super::chain`].

use nalgebra::{SMatrix, SVector};

/// Which second derivatives a step wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Curvature {
    /// The Hessian itself.
    Exact,
    /// A positive semi-definite stand-in: its projection, point by point, for the Eikonal loss; Gauss-Newton's for
    /// returns.
    Convex,
}

/// A function's value, gradient and Hessian in `K` local quantities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalJet<const K: usize> {
    pub value: f64,
    pub gradient: SVector<f64, K>,
    pub hessian: SMatrix<f64, K, K>,
}
