//! Sparse linear algebra on a lattice.
//!
//! Two control points interact where they share a cell, so a Hessian couples points at most 3 apart: a 7 x 7 stencil on
//! a grid. [`StencilMatrix`] stores such a symmetric matrix, [`dissection`] orders the grid so that its Cholesky factor
//! stays sparse, [`Cholesky`] factorises and solves (faer's supernodal kernels on that order), and
//! [`selected_inverse`] gives the entries of the inverse on the stencil without ever forming the inverse.

pub mod dissection;

mod block;
mod cholesky;
mod selected;
mod stencil;

pub use block::CellBlock;
pub(crate) use cholesky::LARGEST_RESIDUAL;
pub use cholesky::{Cholesky, SparseError};
pub use selected::{selected_inverse, selected_sandwich};
pub use stencil::{Stencil, StencilMatrix};
