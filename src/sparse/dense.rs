//! Factors, products and solves of dense blocks, in columns that a team shares.
//!
//! The columns are cut at fixed places, so the same numbers are added in the same order whoever does which of them.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::reborrow::ReborrowMut;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::error::SparseError;
use super::team::Team;

/// Columns that one thread takes at a time: enough that a product keeps its speed.
const COLUMNS: usize = 128;
/// Pivots that one thread factorises at a time, while the others wait.
const PIVOTS: usize = 256;

/// Puts the factor of a panel's pivot rows where their lower triangle is, and `L21 = F21 L11^-T` below them.
pub(super) fn factorise(panel: MatMut<'_, f64>, team: &Team) -> Result<(), SparseError> {
    let mut rest = panel;
    while rest.ncols() > 0 {
        let count = PIVOTS.min(rest.ncols());
        let (own, others) = rest.split_at_col_mut(count);
        let (mut l11, mut l21) = own.split_at_row_mut(count);
        factorise_pivots(l11.rb_mut())?;
        solve_lower(l11.as_ref(), l21.rb_mut().transpose_mut(), team);
        let (_, mut others) = others.split_at_row_mut(count);
        let pivots = l21.as_ref().subrows(0, others.ncols());
        accumulate_lower(others.rb_mut(), l21.as_ref(), pivots.transpose(), -1.0, team);
        rest = others;
    }
    Ok(())
}

fn factorise_pivots(mut block: MatMut<'_, f64>) -> Result<(), SparseError> {
    let need = cholesky_in_place_scratch::<f64>(block.nrows(), Par::Seq, Default::default());
    let mut scratch = MemBuffer::try_new(need).map_err(|error| SparseError::Setup(format!("{error:?}")))?;
    let none = LltRegularization::default();
    cholesky_in_place(block.rb_mut(), none, Par::Seq, MemStack::new(&mut scratch), Default::default())
        .map_err(|_| SparseError::NotPositiveDefinite)?;
    // faer reports a pivot that is not positive; a NaN in the input passes through as NaN pivots.
    match (0..block.nrows()).all(|k| block[(k, k)].is_finite() && block[(k, k)] > 0.0) {
        true => Ok(()),
        false => Err(SparseError::NotPositiveDefinite),
    }
}

/// `(L L^T)^-1`. A column of `L^-1` begins at its pivot: `n^3 / 3` multiply-adds, where whole columns take `3 n^3 / 2`.
pub(super) fn inverse(l: MatRef<'_, f64>, team: &Team) -> Mat<f64> {
    let n = l.nrows();
    let mut root = Mat::<f64>::identity(n, n);
    in_columns(root.as_mut(), team, |first, columns| {
        let (_, own) = columns.split_at_row_mut(first);
        solve_lower_triangular_in_place(l.submatrix(first, first, n - first, n - first), own, Par::Seq);
    });
    let mut whole = Mat::zeros(n, n);
    in_columns(whole.as_mut(), team, |first, columns| {
        let (_, own) = columns.split_at_row_mut(first);
        let right = root.submatrix(first, first, n - first, own.ncols());
        let left = root.submatrix(first, first, n - first, n - first).transpose();
        let (upper, rectangle) = (BlockStructure::TriangularUpper, BlockStructure::Rectangular);
        triangular::matmul(own, rectangle, Accum::Replace, left, upper, right, rectangle, 1.0, Par::Seq);
    });
    mirror(whole.as_mut());
    whole
}

/// `scale a b`.
pub(super) fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64, team: &Team) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    in_columns(out.as_mut(), team, |first, into| {
        matmul(into, Accum::Replace, a, columns_of(b, first), scale, Par::Seq);
    });
    out
}

/// Adds `scale a b`.
pub(super) fn accumulate(into: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64, team: &Team) {
    in_columns(into, team, |first, into| matmul(into, Accum::Add, a, columns_of(b, first), scale, Par::Seq));
}

/// Adds the lower triangle of `scale a b`, which is symmetric, alone or with others.
pub(super) fn accumulate_lower(into: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64, team: &Team) {
    let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
    in_columns(into, team, |first, into| {
        let (count, b) = (into.ncols(), columns_of(b, first));
        let (_, from) = into.split_at_row_mut(first);
        let (square, below) = from.split_at_row_mut(count);
        let (_, a) = a.split_at_row(first);
        let (a_square, a_below) = a.split_at_row(count);
        triangular::matmul(square, lower, Accum::Add, a_square, whole, b, whole, scale, Par::Seq);
        matmul(below, Accum::Add, a_below, b, scale, Par::Seq);
    });
}

/// `L^-1 x` in place.
pub(super) fn solve_lower(l: MatRef<'_, f64>, x: MatMut<'_, f64>, team: &Team) {
    in_columns(x, team, |_, x| solve_lower_triangular_in_place(l, x, Par::Seq));
}

/// `L^-T x` in place.
pub(super) fn solve_lower_transposed(l: MatRef<'_, f64>, x: MatMut<'_, f64>, team: &Team) {
    in_columns(x, team, |_, x| solve_upper_triangular_in_place(l.transpose(), x, Par::Seq));
}

/// Rows and columns of a tile that stays in the cache while it is turned.
const TILE: usize = 32;

/// Copies the lower triangle to the upper, tile by tile.
pub(super) fn mirror(mut square: MatMut<'_, f64>) {
    let n = square.nrows();
    for (first_column, first_row) in (0..n).step_by(TILE).flat_map(|j| (j..n).step_by(TILE).map(move |i| (j, i))) {
        for column in first_column..(first_column + TILE).min(n) {
            for row in first_row.max(column + 1)..(first_row + TILE).min(n) {
                square[(column, row)] = square[(row, column)];
            }
        }
    }
}

/// `work` on each piece of the columns, with the first one's index.
fn in_columns<'m>(of: MatMut<'m, f64>, team: &Team, work: impl Fn(usize, MatMut<'m, f64>) + Sync) {
    if of.ncols() <= COLUMNS {
        return work(0, of);
    }
    let (mut pieces, mut rest, mut first) = (Vec::new(), of, 0);
    while rest.ncols() > COLUMNS {
        let (piece, others) = rest.split_at_col_mut(COLUMNS);
        pieces.push((first, piece));
        (rest, first) = (others, first + COLUMNS);
    }
    pieces.push((first, rest));
    team.each(pieces, |(first, piece)| work(first, piece));
}

fn columns_of(b: MatRef<'_, f64>, first: usize) -> MatRef<'_, f64> {
    b.subcols(first, COLUMNS.min(b.ncols() - first))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::num::NonZero;

    fn wave(rows: usize, columns: usize, pitch: f64) -> Mat<f64> {
        Mat::from_fn(rows, columns, |a, b| (pitch * (a * columns + b) as f64).sin())
    }

    #[test]
    fn a_wide_panel_is_factorised_and_inverted_as_one_block_is() {
        let (n, rows) = (2 * PIVOTS + 75, 2 * PIVOTS + 130);
        let root = wave(rows, rows, 0.7);
        let whole = &root * root.transpose() + Mat::<f64>::identity(rows, rows) * faer::Scale(rows as f64);
        let mut exact = whole.submatrix(0, 0, n, n).to_owned();
        factorise_pivots(exact.as_mut()).unwrap();
        let all = [1, 3].map(|threads| {
            let team = Team::of(NonZero::new(threads).unwrap());
            let mut panel = whole.subcols(0, n).to_owned();
            factorise(panel.as_mut(), &team).unwrap();
            let inverse = inverse(panel.submatrix(0, 0, n, n), &team);
            (panel, inverse)
        });
        let (panel, inverse) = &all[0];
        let lower = |of: MatRef<'_, f64>| Mat::from_fn(n, n, |a, b| if a < b { 0.0 } else { of[(a, b)] });
        let factor = lower(panel.submatrix(0, 0, n, n));
        assert!((&factor - lower(exact.as_ref())).norm_max() < 1e-10 * factor.norm_max());
        let below = panel.subrows(n, rows - n) * factor.transpose();
        assert!((below - whole.submatrix(n, 0, rows - n, n)).norm_max() < 1e-9 * whole.norm_max());
        let product = inverse * whole.submatrix(0, 0, n, n);
        assert!((product - Mat::<f64>::identity(n, n)).norm_max() < 1e-9);
        assert!(all[0] == all[1]);
        let mut singular = whole.subcols(0, n).to_owned();
        singular[(n - 1, n - 1)] = -1.0;
        assert_eq!(factorise(singular.as_mut(), &Team::alone()), Err(SparseError::NotPositiveDefinite));
    }

    #[test]
    fn pieces_are_the_whole_and_the_same_bytes_for_any_team() {
        let (n, k) = (2 * COLUMNS + 37, 41);
        let (a, l) = (wave(n, k, 0.7), wave(k, k, 0.3) + Mat::<f64>::identity(k, k) * faer::Scale(9.0));
        let whole = &a * a.transpose();
        let all = [1, 2, 3].map(|threads| {
            let team = Team::of(NonZero::new(threads).unwrap());
            let mut lower = Mat::zeros(n, n);
            accumulate_lower(lower.as_mut(), a.as_ref(), a.transpose(), 1.0, &team);
            mirror(lower.as_mut());
            let mut solved = a.transpose().to_owned();
            solve_lower(l.as_ref(), solved.as_mut(), &team);
            solve_lower_transposed(l.as_ref(), solved.as_mut(), &team);
            (product(a.as_ref(), a.transpose(), 1.0, &team), lower, solved)
        });
        assert!((&all[0].0 - &whole).norm_max() < 1e-12 && (&all[0].1 - &whole).norm_max() < 1e-12);
        let mut exact = a.transpose().to_owned();
        solve_lower_triangular_in_place(l.as_ref(), exact.as_mut(), Par::Seq);
        solve_upper_triangular_in_place(l.transpose(), exact.as_mut(), Par::Seq);
        assert!((&all[0].2 - &exact).norm_max() < 1e-12);
        assert!(all[1] == all[0] && all[2] == all[0]);
    }
}
