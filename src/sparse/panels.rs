//! A symmetric matrix on the pattern of a supernodal factor, and how its supernodes exchange entries.
//!
//! A supernode's columns share their rows, so they lie in one dense panel: its pivot rows, then the rows below, whose
//! matrix among themselves lies in the panels of supernodes eliminated later. [`Panels::trailing`] gathers that matrix,
//! [`Panels::extend_add`] hands a child's update to its parent (Duff and Reid 1983); both find rows by one walk over two
//! ascending lists.

use std::borrow::Cow;

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::{Mat, MatMut, MatRef};

use super::cholesky::Cholesky;
use super::system::SystemMatrix;

/// A symmetric matrix on the pattern of `L`: per supernode a column-major panel of its pivot rows and the rows below.
pub(super) struct Panels<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<usize>,
    values: Cow<'a, [f64]>,
    /// The supernode that eliminates each step.
    pub owner: Vec<usize>,
}

impl<'a> Panels<'a> {
    pub fn zeros(symbolic: &'a SymbolicSupernodalCholesky<usize>) -> Self {
        Self::with(symbolic, Cow::Owned(vec![0.0; symbolic.len_val()]))
    }

    /// Over the values of another, as [`Panels::into_values`] gave them.
    pub fn holding(symbolic: &'a SymbolicSupernodalCholesky<usize>, values: &'a [f64]) -> Self {
        Self::with(symbolic, Cow::Borrowed(values))
    }

    pub fn into_values(self) -> Vec<f64> {
        self.values.into_owned()
    }

    fn with(symbolic: &'a SymbolicSupernodalCholesky<usize>, values: Cow<'a, [f64]>) -> Self {
        let mut owner = vec![0; symbolic.nrows()];
        for s in 0..symbolic.n_supernodes() {
            owner[symbolic.supernode_begin()[s]..symbolic.supernode_end()[s]].fill(s);
        }
        Self { symbolic, values, owner }
    }

    pub fn width(&self, s: usize) -> usize {
        self.symbolic.supernode_end()[s] - self.symbolic.supernode_begin()[s]
    }

    /// The steps a supernode's panel has rows for: its own, then those below.
    pub fn rows(&self, s: usize) -> Vec<usize> {
        let own = self.symbolic.supernode_begin()[s]..self.symbolic.supernode_end()[s];
        own.chain(self.symbolic.supernode(s).pattern().iter().copied()).collect()
    }

    fn span(&self, s: usize) -> std::ops::Range<usize> {
        self.symbolic.col_ptr_for_val()[s]..self.symbolic.col_ptr_for_val()[s + 1]
    }

    fn height(&self, s: usize) -> usize {
        self.width(s) + self.symbolic.supernode(s).pattern().len()
    }

    pub fn blocks(&self, s: usize) -> (MatRef<'_, f64>, MatRef<'_, f64>) {
        MatRef::from_column_major_slice(&self.values[self.span(s)], self.height(s), self.width(s))
            .split_at_row(self.width(s))
    }

    pub fn blocks_mut(&mut self, s: usize) -> (MatMut<'_, f64>, MatMut<'_, f64>) {
        let (span, height, width) = (self.span(s), self.height(s), self.width(s));
        MatMut::from_column_major_slice_mut(&mut self.values.to_mut()[span], height, width).split_at_row_mut(width)
    }

    pub fn store(&mut self, s: usize, pivot: MatRef<'_, f64>, below: MatRef<'_, f64>) {
        let (mut top, mut bottom) = self.blocks_mut(s);
        top.copy_from(pivot);
        bottom.copy_from(below);
    }

    /// The matrix between the rows below a supernode, gathered from the supernodes that own them.
    pub fn trailing(&self, s: usize) -> Mat<f64> {
        let below = self.symbolic.supernode(s).pattern();
        let mut trailing = Mat::zeros(below.len(), below.len());
        let mut start = 0;
        while start < below.len() {
            let t = self.owner[below[start]];
            let first = self.symbolic.supernode_begin()[t];
            let end = start + below[start..].partition_point(|&step| step < self.symbolic.supernode_end()[t]);
            let places = self.places(t, &below[start..]);
            let panel = &self.values[self.span(t)];
            let height = self.height(t);
            for column in start..end {
                let values = &panel[(below[column] - first) * height..][..height];
                for row in column..below.len() {
                    let value = values[places[row - start]];
                    trailing[(row, column)] = value;
                    trailing[(column, row)] = value;
                }
            }
            start = end;
        }
        trailing
    }

    /// Where each of the ascending `steps` lies among the rows of supernode `t`, which holds them all.
    fn places(&self, t: usize, steps: &[usize]) -> Vec<usize> {
        let (first, end) = (self.symbolic.supernode_begin()[t], self.symbolic.supernode_end()[t]);
        let pattern = self.symbolic.supernode(t).pattern();
        let mut at = 0;
        steps
            .iter()
            .map(|&step| {
                if step < end {
                    return step - first;
                }
                while pattern[at] < step {
                    at += 1;
                }
                end - first + at
            })
            .collect()
    }

    /// Adds a child's update (its lower triangle) to supernode `s`: to its panel, and to `trailing` between the rows
    /// below.
    pub fn extend_add(&mut self, s: usize, trailing: &mut Mat<f64>, child: usize, update: MatRef<'_, f64>) {
        let places = self.places(s, self.symbolic.supernode(child).pattern());
        let (width, height, span) = (self.width(s), self.height(s), self.span(s));
        let panel = &mut self.values.to_mut()[span];
        for (column, &into) in places.iter().enumerate() {
            for (row, &place) in places.iter().enumerate().skip(column) {
                if into < width {
                    panel[into * height + place] += update[(row, column)];
                } else {
                    trailing[(place - width, into - width)] += update[(row, column)];
                }
            }
        }
    }

    /// Puts a matrix's entries in their places; `inverse` gives the step that eliminates each unknown.
    pub fn scatter(&mut self, g: &SystemMatrix, inverse: &[usize]) {
        for (row, column, source) in g.pattern().entries() {
            let at = self.address(inverse[row], inverse[column]);
            self.values.to_mut()[at] = g.values()[source];
        }
        for (row, column, value) in g.pair_entries() {
            let at = self.address(inverse[row], inverse[column]);
            self.values.to_mut()[at] = value;
        }
    }

    /// The entries on a system's own pattern, which the factor's contains.
    pub fn on_pattern(&self, cholesky: &Cholesky, inverse: &[usize]) -> SystemMatrix {
        let pattern = cholesky.pattern();
        let mut matrix = SystemMatrix::zeros(pattern.clone());
        for (row, column, source) in pattern.entries() {
            matrix.set(source, self.values[self.address(inverse[row], inverse[column])]);
        }
        matrix
    }

    /// Where the entry between two steps, which must be on the pattern, lies in the values.
    fn address(&self, a: usize, b: usize) -> usize {
        let (column, row) = (a.min(b), a.max(b));
        let s = self.owner[column];
        let (first, end) = (self.symbolic.supernode_begin()[s], self.symbolic.supernode_end()[s]);
        let place = if row < end {
            row - first
        } else {
            end - first + self.symbolic.supernode(s).pattern().partition_point(|&step| step < row)
        };
        self.symbolic.col_ptr_for_val()[s] + (column - first) * self.height(s) + place
    }
}
