//! Symmetric blocks between the 16 control points of a cell: what a cell adds to a matrix on the lattice.

use crate::spline::SUPPORT;

/// Entries of a symmetric 16 x 16 block's lower triangle.
pub(super) const PACKED: usize = SUPPORT * (SUPPORT + 1) / 2;

/// A symmetric block between a cell's 16 control points: its lower triangle, column by column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellBlock(pub [f64; PACKED]);

impl CellBlock {
    pub const ZERO: Self = Self([0.0; PACKED]);

    /// The symmetric product `a b^T + b a^T`, halved: its quadratic form is `(a.x)(b.x)`.
    pub fn symmetric_product(a: &[f64; SUPPORT], b: &[f64; SUPPORT]) -> Self {
        let mut block = Self::ZERO;
        let mut packed = 0;
        for column in 0..SUPPORT {
            for row in column..SUPPORT {
                block.0[packed] = 0.5 * (a[row] * b[column] + b[row] * a[column]);
                packed += 1;
            }
        }
        block
    }

    /// The lower triangle of `a b^T`: what a block between two components holds of it.
    pub fn outer(a: &[f64; SUPPORT], b: &[f64; SUPPORT]) -> Self {
        let mut block = Self::ZERO;
        let pairs = b.iter().enumerate().flat_map(|(column, b)| a[column..].iter().map(move |a| a * b));
        block.0.iter_mut().zip(pairs).for_each(|(into, value)| *into = value);
        block
    }

    /// Adds `weight` times another block.
    #[inline]
    pub fn add_scaled(&mut self, weight: f64, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(into, value)| *into += weight * value);
    }

    /// Adds `sum_i rows[i] images[i]^T`, which must be symmetric as a whole.
    #[inline]
    pub fn add_products<const K: usize>(&mut self, rows: [&[f64; SUPPORT]; K], images: &[[f64; SUPPORT]; K]) {
        let mut packed = 0;
        for column in 0..SUPPORT {
            let length = SUPPORT - column;
            let into = &mut self.0[packed..packed + length];
            for k in 0..K {
                let factor = images[k][column];
                into.iter_mut().zip(&rows[k][column..]).for_each(|(into, row)| *into += row * factor);
            }
            packed += length;
        }
    }

    /// The product with a vector.
    pub fn times(&self, x: &[f64; SUPPORT]) -> [f64; SUPPORT] {
        let (mut y, mut packed) = ([0.0; SUPPORT], 0);
        for column in 0..SUPPORT {
            y[column] += self.0[packed] * x[column];
            packed += 1;
            for row in column + 1..SUPPORT {
                y[row] += self.0[packed] * x[column];
                y[column] += self.0[packed] * x[row];
                packed += 1;
            }
        }
        y
    }

    /// The bilinear form `a^T block b`.
    pub fn bilinear(&self, a: &[f64; SUPPORT], b: &[f64; SUPPORT]) -> f64 {
        self.times(b).iter().zip(a).map(|(y, a)| y * a).sum()
    }
}
