//! How uncertain a fitted map is, from the exact Hessian at its minimum.
//!
//! Two covariances of the coefficients:
//!
//! - *propagated*: the input noise carried to the minimum by the implicit function theorem. At a minimum
//!   `grad f(z; inputs) = 0`, so `dz = -M^-1 (d2f / dz dinputs) dinputs` with `M` the exact Hessian in all unknowns, and
//!   `C = M^-1 B B^T M^-1` with `B` the mixed derivatives times a square root of the inputs' covariance: a column a range
//!   and three a pose, so the returns of a scan share its pose's error. Where nothing depends on the inputs it is zero:
//!   that is not certainty.
//! - *posterior*: `2 M^-1` (the objective has no factor 1/2), the Laplace approximation; it grows where nothing was seen.
//!
//! With refined poses both are marginal over them. [`Marginals`] holds the entries between control points that share a
//! cell, by selected inversion ([`marginals`]); [`Factors`] is what any entry can be formed from (`factors`).

mod apart;
mod factors;
mod inputs;
mod marginals;
mod vector;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use apart::published_marginals;
pub use factors::{Factors, Reduced};
pub use inputs::{CompressedColumns, PoseInputs, RangeInputs};
pub use marginals::{Marginals, PoseCovariance, marginals};
pub use vector::{VectorCovariance, VectorMarginals, vector_marginals};

use crate::sparse::SparseError;

/// Which covariance; see the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    #[default]
    Propagated,
    Posterior,
}

#[derive(Debug, Error, Clone, PartialEq)]
pub enum UncertaintyError {
    #[error("the Hessian at the end of the fit is singular; the fit did not reach a minimum")]
    NoMinimum,
    #[error("the stored factors do not fit together: {0}")]
    Malformed(&'static str),
    #[error(transparent)]
    Sparse(SparseError),
}

impl From<SparseError> for UncertaintyError {
    fn from(error: SparseError) -> Self {
        match error {
            SparseError::NotPositiveDefinite => Self::NoMinimum,
            other => Self::Sparse(other),
        }
    }
}

#[cfg(test)]
mod tests;
