//! A symmetric matrix over control points and poses, part by part.
//!
//! Its parts lie in one vector: blocks of the stencil in the order xx (one component), or xx, xy, yx, yy; three numbers
//! for every pair of a pose and a control point it sees, component by component; nine a pose. Entry (row, column) of
//! block xy is between the x coefficient of the row's control point and the y coefficient of the column's, for rows no
//! lower than columns.

use std::collections::BTreeMap;
use std::sync::Arc;

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use super::block::CellBlock;
use super::pattern::Pattern;
use super::stencil::StencilMatrix;
use crate::spline::SUPPORT;

#[derive(Debug, Clone)]
pub struct SystemMatrix {
    pattern: Arc<Pattern>,
    values: Vec<f64>,
    /// Blocks between poses, by the greater and the lesser one: entries of a factor's pattern, not of the matrix's own.
    pairs: BTreeMap<(usize, usize), Matrix3<f64>>,
}

/// A symmetric matrix that faer can factorise and whose solves can be checked.
pub trait Symmetric {
    /// The lower triangle's values in the order of the pattern's entries.
    fn lower(&self) -> Vec<f64>;
    /// The product with a vector.
    fn times(&self, x: &[f64]) -> Vec<f64>;
}

impl SystemMatrix {
    pub fn zeros(pattern: Arc<Pattern>) -> Self {
        let values = vec![0.0; pattern.parts().end];
        Self { pattern, values, pairs: BTreeMap::new() }
    }

    pub fn pattern(&self) -> &Arc<Pattern> {
        &self.pattern
    }

    /// All parts; see the module.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    pub fn clear(&mut self) {
        self.values.fill(0.0);
        self.pairs.clear();
    }

    pub fn scale(&mut self, factor: f64) {
        self.values.iter_mut().for_each(|v| *v *= factor);
    }

    /// Adds a multiple of another matrix on the same pattern.
    pub fn add_scaled(&mut self, factor: f64, other: &Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(into, v)| *into += factor * v);
    }

    /// The values of the block between two components.
    pub fn block(&self, row: usize, column: usize) -> &[f64] {
        let (size, k) = (self.pattern.stencil().len(), row * self.pattern.components() + column);
        &self.values[k * size..(k + 1) * size]
    }

    /// The block between two components, by itself.
    pub fn stencil_block(&self, row: usize, column: usize) -> StencilMatrix {
        let stencil = self.pattern.stencil();
        let mut block = StencilMatrix::zeros(stencil.clone());
        block.values.copy_from_slice(self.block(row, column));
        if row < column {
            // What lies on the diagonal of both blocks between components is kept in the lower one.
            let lower = self.block(column, row);
            (0..stencil.dimension()).map(|k| stencil.column(k).start).for_each(|at| block.values[at] = lower[at]);
        }
        block
    }

    /// Adds a cell's block between two components.
    #[inline]
    pub fn add_cell(&mut self, (row, column): (usize, usize), first: usize, block: &CellBlock) {
        let (size, k) = (self.pattern.stencil().len(), row * self.pattern.components() + column);
        self.pattern.stencil().add_cell(first, block, &mut self.values[k * size..(k + 1) * size]);
    }

    /// Adds to the block of a component with itself.
    pub fn add_diagonal_block(&mut self, component: usize, values: &[f64], factor: f64) {
        let size = self.pattern.stencil().len();
        let k = component * (self.pattern.components() + 1);
        self.values[k * size..(k + 1) * size].iter_mut().zip(values).for_each(|(into, v)| *into += factor * v);
    }

    /// Adds `shift(k, p)` to the diagonal entry of control point `p` of component `k`.
    pub fn shift_diagonal(&mut self, shift: impl Fn(usize, usize) -> f64) {
        let stencil = self.pattern.stencil().clone();
        for component in 0..self.pattern.components() {
            let first = component * (self.pattern.components() + 1) * stencil.len();
            for point in 0..stencil.dimension() {
                self.values[first + stencil.column(point).start] += shift(component, point);
            }
        }
    }

    /// Adds `scale` times the outer product of a cell's numbers, of a component, with three of a pose. Control points
    /// that the pose does not see are an error of the caller.
    #[inline]
    pub fn add_coupling(
        &mut self,
        (component, pose): (usize, usize),
        support: &[usize; SUPPORT],
        row: impl Fn(usize) -> Vector3<f64>,
    ) {
        let (views, start) = (self.pattern.views(), self.pattern.parts().coupling);
        // Four control points of a cell's row are neighbours in the view, too.
        for corner in (0..SUPPORT).step_by(4) {
            let Some(at) = views.position(pose, support[corner]) else { continue };
            let first = start + 3 * (component * views.len() + at);
            for k in 0..4 {
                let value = row(corner + k);
                (0..3).for_each(|a| self.values[first + 3 * k + a] += value[a]);
            }
        }
    }

    /// Adds to a pose's own block.
    #[inline]
    pub fn add_pose(&mut self, pose: usize, block: &Matrix3<f64>) {
        let first = self.pattern.parts().poses + 9 * pose;
        (0..9).for_each(|k| self.values[first + k] += block[(k / 3, k % 3)]);
    }

    /// Adds to the block between two different poses, which the factor must hold ([`super::Cholesky::holds`]).
    pub fn add_pair(&mut self, (a, b): (usize, usize), block: &Matrix3<f64>) {
        match a > b {
            true => *self.pairs.entry((a, b)).or_default() += block,
            false => *self.pairs.entry((b, a)).or_default() += block.transpose(),
        }
    }

    /// The entries between different poses, as (row, column, value).
    pub(super) fn pair_entries(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let first = self.pattern.coefficients();
        self.pairs.iter().flat_map(move |((a, b), block)| {
            (0..9).map(move |k| (first + 3 * a + k / 3, first + 3 * b + k % 3, block[(k / 3, k % 3)]))
        })
    }

    /// A pose's own block.
    pub fn pose(&self, pose: usize) -> Matrix3<f64> {
        let first = self.pattern.parts().poses + 9 * pose;
        let own = Matrix3::from_row_slice(&self.values[first..first + 9]);
        // Of a matrix gathered from a factor the lower triangle alone is filled.
        Matrix3::from_fn(|a, b| own[(a.max(b), a.min(b))])
    }

    /// The diagonal, unknown by unknown.
    pub fn diagonal(&self) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.pattern.dimension()];
        self.pattern
            .entries()
            .filter(|(row, column, _)| row == column)
            .for_each(|(row, _, at)| diagonal[row] = self.values[at]);
        diagonal
    }

    /// Adds the entries of `scale (A B^T + B A^T) / 2` that are on the pattern; rows are unknowns.
    pub fn add_products(&mut self, a: &Mat<f64>, b: &Mat<f64>, scale: f64) {
        let pattern = self.pattern.clone();
        let half = 0.5 * scale;
        for (row, column, at) in pattern.entries() {
            let product = (0..a.ncols()).map(|k| a[(row, k)] * b[(column, k)] + b[(row, k)] * a[(column, k)]);
            self.values[at] += half * product.sum::<f64>();
        }
    }

    pub(super) fn set(&mut self, source: usize, value: f64) {
        self.values[source] = value;
    }

    pub fn to_dense(&self) -> Mat<f64> {
        let n = self.pattern.dimension();
        let mut dense = Mat::zeros(n, n);
        for (row, column, at) in self.pattern.entries() {
            dense[(row, column)] = self.values[at];
            dense[(column, row)] = self.values[at];
        }
        for (row, column, value) in self.pair_entries() {
            dense[(row, column)] = value;
            dense[(column, row)] = value;
        }
        dense
    }
}

impl Symmetric for SystemMatrix {
    fn lower(&self) -> Vec<f64> {
        self.pattern.sources().iter().map(|&at| self.values[at]).collect()
    }

    fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for (row, column, value) in self.pair_entries() {
            y[row] += value * x[column];
            y[column] += value * x[row];
        }
        for column in 0..x.len() {
            let (rows, places) = self.pattern.column(column);
            let (own, mut sum) = (x[column], 0.0);
            for (&row, &at) in rows.iter().zip(places) {
                let value = self.values[at];
                y[row] += value * own;
                sum += if row == column { 0.0 } else { value * x[row] };
            }
            y[column] += sum;
        }
        y
    }
}

impl Symmetric for StencilMatrix {
    fn lower(&self) -> Vec<f64> {
        self.values.clone()
    }

    fn times(&self, x: &[f64]) -> Vec<f64> {
        StencilMatrix::times(self, x)
    }
}
