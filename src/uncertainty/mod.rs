//! How uncertain an estimate is, from the exact Hessian at its minimum.
//!
//! Two covariances of the unknowns, control points and poses:
//!
//! - *propagated*: the input noise carried to the minimum by the implicit function theorem. At a minimum
//!   `grad f(z; inputs) = 0`, so `dz = -M^-1 (d2f / dz dinputs) dinputs` with `M` the exact Hessian in all unknowns, and
//!   `C = M^-1 B B^T M^-1` with `B` the mixed derivatives times a square root of the inputs' covariance: a column a range
//!   and three a pose, so the returns of a scan share its pose's error. Where nothing depends on the inputs it is zero:
//!   that is not certainty.
//! - *posterior*: `2 M^-1` (the objective has no factor 1/2), the Laplace approximation; it grows where nothing was seen.
//!
//! [`Marginals`] holds the entries on the pattern, by selected inversion ([`marginals`]): control points that share a
//! cell, poses, and poses with what they see. [`Joint`] forms those between any few coefficients (`joint`), [`Factors`] is
//! what a client can form any entry from (`factors`).

mod columns;
mod factors;
mod frames;
mod joint;
mod marginals;
mod modes;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use columns::CompressedColumns;
pub use factors::{ExportedFactors, Factors};
pub use frames::{FrameShift, frame_shifts};
pub use joint::Joint;
pub use marginals::{Marginals, PoseCovariance, marginals};

use crate::sparse::SparseError;

/// Which covariance; see the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    #[default]
    Propagated,
    Posterior,
}

impl Kind {
    pub const ALL: [Self; 2] = [Self::Propagated, Self::Posterior];
}

#[derive(Debug, Error, Clone, PartialEq)]
pub enum UncertaintyError {
    #[error("the Hessian at the end of the fit is not positive definite; the fit did not reach a minimum")]
    NoMinimum,
    #[error(
        "the scans do not determine the map, or not to f64's precision: {detail}. More scans or beams, a coarser \
         resolution, or noise in proportion to it would help"
    )]
    IllConditioned { detail: String },
    #[error("the stored factors do not fit together: {0}")]
    Malformed(&'static str),
    #[error("cancelled")]
    Cancelled,
    #[error(transparent)]
    Sparse(SparseError),
}

impl From<SparseError> for UncertaintyError {
    fn from(error: SparseError) -> Self {
        match error {
            SparseError::NotPositiveDefinite => Self::NoMinimum,
            SparseError::Stopped => Self::Cancelled,
            other => Self::Sparse(other),
        }
    }
}

#[cfg(test)]
mod tests;
