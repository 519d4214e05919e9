//! The 7 x 7 stencil: the pattern of a lattice's Hessian, and symmetric matrices on it.
//!
//! Only the lower triangle is stored, column by column (CSC): below the diagonal of column `(i, j)` lie the rows
//! `(i + di, j + dj)` with `dj = 0, di in 0..=3` or `dj in 1..=3, di in -3..=3`, 25 slots of which the lattice's edges
//! cut some off. In natural order those rows ascend with the slot, so the pattern needs no sorting, and where entry
//! `(row, column)` lies is one table look-up.
//!
//! Control points that nothing is known of may be left out ([`Stencil::over`]): they keep their index, so arrays stay
//! rectangular, but only their diagonal entry, so they cost nothing and fill in nothing.

use std::sync::Arc;

use faer::Mat;

use super::block::{CellBlock, PACKED};
use crate::spline::{Lattice, SUPPORT};

const SLOTS: usize = 25;
const ABSENT: usize = usize::MAX;

/// The slot of every packed entry of a cell's block: it depends on the offset between the two control points alone.
const CELL_SLOTS: [usize; PACKED] = {
    let mut slots = [0; PACKED];
    let (mut packed, mut b) = (0, 0);
    while b < SUPPORT {
        let mut a = b;
        while a < SUPPORT {
            slots[packed] = slot((a % 4) as isize - (b % 4) as isize, (a / 4) as isize - (b / 4) as isize);
            packed += 1;
            a += 1;
        }
        b += 1;
    }
    slots
};

/// The pattern shared by every matrix of one lattice.
#[derive(Debug, Clone, PartialEq)]
pub struct Stencil {
    size: [usize; 2],
    column_starts: Vec<usize>,
    rows: Vec<usize>,
    /// Where slot `s` of column `k` lies in the values, at `k * SLOTS + s`.
    positions: Vec<usize>,
    /// The control points in use; `None` for all.
    active: Option<Vec<bool>>,
}

/// The slot of the row at grid offset `(di, dj)` from its column.
const fn slot(di: isize, dj: isize) -> usize {
    if dj == 0 { di as usize } else { (4 + (dj - 1) * 7 + di + 3) as usize }
}

impl Stencil {
    /// The pattern of a lattice's control points.
    pub fn of(lattice: &Lattice) -> Arc<Self> {
        Self::of_grid(lattice.control_points())
    }

    /// The pattern of an `nx x ny` grid.
    pub fn of_grid(size: [usize; 2]) -> Arc<Self> {
        Self::build(size, None)
    }

    /// The pattern of the control points of the cells that are marked, x fastest.
    pub fn of_cells(lattice: &Lattice, cells: &[bool]) -> Arc<Self> {
        let mut active = vec![false; lattice.len()];
        for (k, _) in cells.iter().enumerate().filter(|(_, marked)| **marked) {
            lattice
                .support([k % lattice.cells[0], k / lattice.cells[0]])
                .iter()
                .for_each(|&point| active[point] = true);
        }
        Self::over(lattice, active)
    }

    /// The pattern of the control points that `active` names, one mark each.
    pub fn over(lattice: &Lattice, active: Vec<bool>) -> Arc<Self> {
        Self::build(lattice.control_points(), Some(active))
    }

    fn build(size: [usize; 2], active: Option<Vec<bool>>) -> Arc<Self> {
        let [nx, ny] = [size[0] as isize, size[1] as isize];
        let n = size[0] * size[1];
        let mut stencil = Self {
            size,
            column_starts: Vec::with_capacity(n + 1),
            rows: Vec::new(),
            positions: vec![ABSENT; n * SLOTS],
            active,
        };
        for column in 0..n {
            stencil.column_starts.push(stencil.rows.len());
            let (i, j) = ((column % size[0]) as isize, (column / size[0]) as isize);
            for dj in 0..=3.min(ny - 1 - j) {
                let first = if dj == 0 { 0 } else { -3 };
                for di in first.max(-i)..=3.min(nx - 1 - i) {
                    let row = (column as isize + di + dj * nx) as usize;
                    if row == column || (stencil.is_active(row) && stencil.is_active(column)) {
                        stencil.positions[column * SLOTS + slot(di, dj)] = stencil.rows.len();
                        stencil.rows.push(row);
                    }
                }
            }
        }
        stencil.column_starts.push(stencil.rows.len());
        Arc::new(stencil)
    }

    /// The number of control points.
    pub fn dimension(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// The number of control points along x and y.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Whether a control point is in use.
    #[inline]
    pub fn is_active(&self, point: usize) -> bool {
        self.active.as_ref().is_none_or(|active| active[point])
    }

    /// Whether all control points of the cell with this lowest one are in use.
    #[inline]
    pub fn is_active_cell(&self, first: usize) -> bool {
        self.active.is_none() || (0..SUPPORT).all(|k| self.is_active(first + k % 4 + (k / 4) * self.size[0]))
    }

    /// The number of control points in use.
    pub fn active_len(&self) -> usize {
        self.active.as_ref().map_or(self.dimension(), |active| active.iter().filter(|a| **a).count())
    }

    /// The number of stored entries: those of the lower triangle.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no entry, which only an empty grid has.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Every stored entry as (row, column), in the order of the values.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.dimension())
            .flat_map(move |column| self.column(column).map(move |position| (self.rows[position], column)))
    }

    /// Where a column's entries lie in the values.
    pub fn column(&self, column: usize) -> std::ops::Range<usize> {
        self.column_starts[column]..self.column_starts[column + 1]
    }

    /// The row of a stored entry.
    pub fn row(&self, position: usize) -> usize {
        self.rows[position]
    }

    /// Where the entry of two control points lies in the values, or `None` where they share no cell.
    pub fn position(&self, p: usize, q: usize) -> Option<usize> {
        let (column, row) = (p.min(q), p.max(q));
        let nx = self.size[0] as isize;
        let (dj, di) = (row as isize / nx - column as isize / nx, row as isize % nx - column as isize % nx);
        if !(0..=3).contains(&dj) || di.abs() > 3 {
            return None;
        }
        Some(self.positions[column * SLOTS + slot(di, dj)]).filter(|&position| position != ABSENT)
    }

    /// Adds a block between a cell's control points, which are those of [`Lattice::support`] with `first` the lowest, to
    /// values in the order of [`Stencil::entries`].
    #[inline]
    pub(super) fn add_cell(&self, first: usize, block: &CellBlock, values: &mut [f64]) {
        let nx = self.size[0];
        let mut packed = 0;
        for b in 0..SUPPORT {
            let column = first + b % 4 + (b / 4) * nx;
            let positions = &self.positions[column * SLOTS..(column + 1) * SLOTS];
            for &slot in &CELL_SLOTS[packed..packed + SUPPORT - b] {
                values[positions[slot]] += block.0[packed];
                packed += 1;
            }
        }
    }
}

/// A symmetric matrix on a [`Stencil`].
#[derive(Debug, Clone)]
pub struct StencilMatrix {
    stencil: Arc<Stencil>,
    /// The lower triangle's entries in the order of [`Stencil::entries`].
    pub values: Vec<f64>,
}

impl StencilMatrix {
    pub fn zeros(stencil: Arc<Stencil>) -> Self {
        let values = vec![0.0; stencil.len()];
        Self { stencil, values }
    }

    pub fn stencil(&self) -> &Arc<Stencil> {
        &self.stencil
    }

    /// Adds a block between a cell's control points, which are those of [`Lattice::support`] with `first` the lowest.
    #[inline]
    pub fn add_cell(&mut self, first: usize, block: &CellBlock) {
        self.stencil.add_cell(first, block, &mut self.values);
    }

    /// The block between a cell's control points.
    #[inline]
    pub fn cell(&self, first: usize) -> CellBlock {
        let nx = self.stencil.size[0];
        let mut block = CellBlock::ZERO;
        let mut packed = 0;
        for b in 0..SUPPORT {
            let column = first + b % 4 + (b / 4) * nx;
            let positions = &self.stencil.positions[column * SLOTS..(column + 1) * SLOTS];
            for &slot in &CELL_SLOTS[packed..packed + SUPPORT - b] {
                block.0[packed] = self.values[positions[slot]];
                packed += 1;
            }
        }
        block
    }

    /// The quadratic form of a cell's block, without forming the block: what a variance costs.
    #[inline]
    pub fn cell_form(&self, first: usize, x: &[f64; SUPPORT]) -> f64 {
        let nx = self.stencil.size[0];
        let (mut total, mut packed) = (0.0, 0);
        for b in 0..SUPPORT {
            let column = first + b % 4 + (b / 4) * nx;
            let positions = &self.stencil.positions[column * SLOTS..(column + 1) * SLOTS];
            let mut sum = 0.5 * self.values[positions[0]] * x[b];
            for (&slot, x) in CELL_SLOTS[packed + 1..packed + SUPPORT - b].iter().zip(&x[b + 1..]) {
                sum += self.values[positions[slot]] * x;
            }
            total += sum * x[b];
            packed += SUPPORT - b;
        }
        2.0 * total
    }

    /// The diagonal.
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.stencil.dimension()).map(|k| self.values[self.stencil.column_starts[k]]).collect()
    }

    pub fn set_diagonal(&mut self, diagonal: &[f64]) {
        diagonal.iter().enumerate().for_each(|(k, value)| self.values[self.stencil.column_starts[k]] = *value);
    }

    /// Adds `shift[k]` to diagonal entry `k`.
    pub fn shift_diagonal(&mut self, shift: impl Fn(usize) -> f64) {
        for k in 0..self.stencil.dimension() {
            self.values[self.stencil.column_starts[k]] += shift(k);
        }
    }

    /// The product with a vector.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for column in 0..self.stencil.dimension() {
            let mut sum = 0.0;
            for position in self.stencil.column(column) {
                let (row, value) = (self.stencil.rows[position], self.values[position]);
                sum += value * x[row];
                if row != column {
                    y[row] += value * x[column];
                }
            }
            y[column] += sum;
        }
        y
    }

    /// The matrix, dense: for references in tests and for small exports.
    pub fn to_dense(&self) -> Mat<f64> {
        let n = self.stencil.dimension();
        let mut dense = Mat::zeros(n, n);
        for ((row, column), &value) in self.stencil.entries().zip(&self.values) {
            dense[(row, column)] = value;
            dense[(column, row)] = value;
        }
        dense
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stencil_holds_exactly_the_pairs_that_share_a_cell() {
        let stencil = Stencil::of_grid([6, 5]);
        let stored: std::collections::BTreeSet<_> = stencil.entries().collect();
        for p in 0..30usize {
            for q in 0..=p {
                let near = (p % 6).abs_diff(q % 6) <= 3 && (p / 6).abs_diff(q / 6) <= 3;
                assert_eq!(stored.contains(&(p, q)), near, "entry ({p}, {q})");
                assert_eq!(stencil.position(q, p).is_some(), near, "position of ({p}, {q})");
            }
        }
    }

    #[test]
    fn control_points_left_out_keep_their_diagonal_alone() {
        let lattice = Lattice { origin: [0.0; 2], resolution: 1.0, cells: [4, 3] };
        let active: Vec<bool> = (0..lattice.len()).map(|k| k % 7 < 5).collect();
        let stencil = Stencil::over(&lattice, active.clone());
        assert!(stencil.entries().all(|(p, q)| p == q || (active[p] && active[q])));
        assert_eq!(stencil.entries().filter(|(p, q)| p == q).count(), lattice.len());
        assert_eq!(stencil.position(5, 4), None);
        assert!(stencil.is_active_cell(0) && !stencil.is_active_cell(2));
    }

    #[test]
    fn a_cell_block_lands_where_it_is_read_back() {
        let mut matrix = StencilMatrix::zeros(Stencil::of_grid([7, 6]));
        let a: [f64; SUPPORT] = std::array::from_fn(|k| (k as f64).sin());
        let b: [f64; SUPPORT] = std::array::from_fn(|k| (k as f64 * 1.7).cos());
        let block = CellBlock::symmetric_product(&a, &b);
        matrix.add_cell(9, &block);
        assert_eq!(matrix.cell(9), block);
        assert!((matrix.cell_form(9, &a) - block.bilinear(&a, &a)).abs() < 1e-12);
        let norms = (a.iter().map(|v| v * v).sum::<f64>(), b.iter().map(|v| v * v).sum::<f64>());
        let dot: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
        assert!((block.bilinear(&a, &b) - 0.5 * (norms.0 * norms.1 + dot * dot)).abs() < 1e-12);
        let mut same = CellBlock::ZERO;
        let halves = [b.map(|v| 0.5 * v), a.map(|v| 0.5 * v)];
        same.add_products([&a, &b], &halves);
        assert!(same.0.iter().zip(&block.0).all(|(x, y)| (x - y).abs() < 1e-15));
        let dense = matrix.to_dense();
        let x: Vec<f64> = (0..42).map(|k| (k as f64 * 0.7).cos()).collect();
        for (row, y) in matrix.times(&x).into_iter().enumerate() {
            let exact: f64 = (0..42).map(|k| dense[(row, k)] * x[k]).sum();
            assert!((y - exact).abs() < 1e-10);
        }
    }
}
