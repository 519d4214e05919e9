//! Sparse linear algebra on a lattice, and on a lattice with poses.
//!
//! Two control points interact where they share a cell, so a Hessian couples points at most 3 apart: a 7 x 7 stencil on
//! a grid, which [`StencilMatrix`] stores. A [`Pattern`] has one or two such components and the poses that see them, a
//! [`SystemMatrix`] the values. [`dissection`] orders both so that the Cholesky factor stays sparse, [`Cholesky`]
//! factorises and solves (supernode by supernode on that order, with faer's dense kernels), and [`selected_inverse`] gives
//! the entries of the inverse on the pattern without ever forming the inverse; [`Paths`] those between any few unknowns.
//! Branches of the elimination tree are shared by a [`Team`] of threads, and as [`Parcel`]s with others elsewhere.

pub mod dissection;

mod abroad;
mod ascent;
mod block;
mod branch;
mod cholesky;
mod dense;
mod division;
mod error;
mod few;
mod pace;
mod packing;
mod parcel;
mod paths;
mod pattern;
mod selected;
mod shared;
mod stencil;
mod system;
mod tasks;
mod team;
mod tree;
mod walk;

pub use abroad::{Abroad, Offer};
pub use block::CellBlock;
pub use cholesky::Cholesky;
pub(crate) use cholesky::LARGEST_RESIDUAL;
pub use error::SparseError;
pub use parcel::{Answer, Parcel};
pub use paths::{Of, Paths};
pub use pattern::{Pattern, Views};
pub use selected::{selected_inverse, selected_sandwich};
pub use stencil::{Stencil, StencilMatrix};
pub use system::{Symmetric, SystemMatrix};
pub use tasks::Task;
pub use team::{Lender, Parts, Team};
