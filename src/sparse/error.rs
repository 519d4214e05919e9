//! What can go wrong with a sparse system, and how large one may be.

use thiserror::Error;

/// Entries of a factor at most: their addresses are of 32 bits. What fits into memory is the caller's to know (`map::cost`).
pub(super) const LARGEST_FACTOR: usize = u32::MAX as usize;
/// Entries between poses that see one place, at most: 2 GB for what is no larger map, but a crowd of scans.
pub(super) const LARGEST_CLIQUE: usize = 250_000_000;

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
    #[error(
        "the map is too large to be fitted as one: its factor would have {entries} entries, the limit is {limit}. A \
         coarser resolution, or a smaller area, would help"
    )]
    TooMuchFill { entries: usize, limit: usize },
    #[error("a linear solve left a residual of {residual:.1e} relative to its right-hand side")]
    Residual { residual: f64 },
}
