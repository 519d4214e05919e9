//! Uniform cubic B-spline surfaces over the plane.
//!
//! A lattice of control points with spacing `h` spans a rectangle of square cells; in each cell the surface is a
//! bicubic polynomial of the 16 control points around it, and it is twice continuously differentiable everywhere.
//! Every linear functional the fit needs (value, gradient, second derivatives at a point) is 16 numbers.

mod basis;
mod lattice;
mod surface;

pub(crate) use basis::dot;
pub use basis::{BasisRow, SUPPORT, cubic};
pub use lattice::{Lattice, LatticeError, Located};
pub use surface::{Jet, Surface};
pub(crate) use surface::{gather, third_derivatives};
