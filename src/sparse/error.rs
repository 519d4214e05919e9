//! What can go wrong with a sparse system, and how large one may be.

use thiserror::Error;

/// Entries of a factor at most: 2 GB, of which a covariance takes four times as much.
pub(super) const LARGEST_FACTOR: usize = 250_000_000;

#[derive(Debug, Error, Clone, PartialEq)]
pub enum SparseError {
    #[error("the matrix is not positive definite")]
    NotPositiveDefinite,
    #[error("the sparse factorisation could not be set up: {0}")]
    Setup(String),
    #[error("stopped")]
    Stopped,
    #[error(
        "too many poses see the same places: the system would have {entries} entries, the limit is {limit}. Fewer \
         scans (every second one, say), or a smaller area, would help"
    )]
    TooLarge { entries: usize, limit: usize },
    #[error("a linear solve left a residual of {residual:.1e} relative to its right-hand side")]
    Residual { residual: f64 },
}
