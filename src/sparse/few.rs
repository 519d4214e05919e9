//! Solves and products of a supernode's panel with few right-hand sides.
//!
//! A panel is read once a call, in the order it lies in memory. Kernels made for many right-hand sides go through it row
//! by row of tiles, which with a handful of them means another page of memory for every few numbers: seven eighths of the
//! time that a scan's covariance took.

use faer::{Mat, MatRef};

/// More right-hand sides than this are many.
pub(super) const FEW: usize = 16;
/// Columns of a panel that are taken together: a right-hand side is read and written once for so many.
const TOGETHER: usize = 4;

/// A supernode's columns: its pivot block, and the rows below it.
#[derive(Clone, Copy)]
pub(super) struct Panel<'a> {
    values: &'a [f64],
    height: usize,
    width: usize,
}

impl<'a> Panel<'a> {
    pub fn new(values: &'a [f64], height: usize, width: usize) -> Self {
        Self { values, height, width }
    }

    /// The pivot block, and the rows below it.
    pub fn blocks(self) -> (MatRef<'a, f64>, MatRef<'a, f64>) {
        MatRef::from_column_major_slice(self.values, self.height, self.width).split_at_row(self.width)
    }

    /// A column, from a row on.
    fn column(self, column: usize, row: usize) -> &'a [f64] {
        &self.values[column * self.height + row..(column + 1) * self.height]
    }

    /// Of a factor's panel: each of `sides` is `L11^-1` times itself in the pivot's rows, and less `L21` times that below.
    pub fn eliminate(self, sides: &mut [Mat<f64>]) {
        for (first, count) in groups(self.width) {
            for x in sides.iter_mut() {
                for k in 0..x.ncols() {
                    let (solved, rest) = x.col_as_slice_mut(k).split_at_mut(first + count);
                    let own = &mut solved[first..];
                    for j in 0..count {
                        let column = self.column(first + j, first);
                        own[j] /= column[j];
                        for i in j + 1..count {
                            own[i] -= column[i] * own[j];
                        }
                    }
                    self.take(first, first + count, own, rest);
                }
            }
        }
    }

    /// `x - A v`, `A` being all of the panel, its pivot block full.
    pub fn take_product(self, v: MatRef<'_, f64>, x: &mut Mat<f64>) {
        for (first, count) in groups(self.width) {
            for k in 0..x.ncols() {
                let own: [f64; TOGETHER] = std::array::from_fn(|j| if j < count { v[(first + j, k)] } else { 0.0 });
                self.take(first, 0, &own[..count], x.col_as_slice_mut(k));
            }
        }
    }

    /// Takes columns `first..`, from a row on, each times its value, from `x`.
    fn take(self, first: usize, row: usize, values: &[f64], x: &mut [f64]) {
        if let &[v0, v1, v2, v3] = values {
            let [a0, a1, a2, a3] = [0, 1, 2, 3].map(|j| self.column(first + j, row));
            for ((((x, a0), a1), a2), a3) in x.iter_mut().zip(a0).zip(a1).zip(a2).zip(a3) {
                *x -= (a0 * v0 + a1 * v1) + (a2 * v2 + a3 * v3);
            }
            return;
        }
        for (j, value) in values.iter().enumerate() {
            x.iter_mut().zip(self.column(first + j, row)).for_each(|(x, a)| *x -= a * value);
        }
    }
}

/// Columns taken together: the first, and how many.
fn groups(width: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..width).step_by(TOGETHER).map(move |first| (first, TOGETHER.min(width - first)))
}

#[cfg(test)]
mod tests {
    use faer::linalg::matmul::matmul;
    use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
    use faer::{Accum, Par};

    use super::*;

    /// A panel with a pivot block that is worth solving with, and what it is made of.
    fn panel(height: usize, width: usize) -> Vec<f64> {
        let value = |k: usize| ((k * 37 + 11) % 101) as f64 / 101.0 - 0.5;
        (0..height * width).map(|k| if k / height == k % height { 2.0 + value(k).abs() } else { value(k) }).collect()
    }

    #[test]
    fn few_right_hand_sides_get_what_many_get() {
        for (height, width) in [(1, 1), (9, 3), (40, 4), (57, 22), (23, 23)] {
            let values = panel(height, width);
            let panel = Panel::new(&values, height, width);
            let few = Mat::from_fn(height, 3, |i, k| (1 + i + 3 * k) as f64 % 7.0 - 3.0);
            let compare = |few: &Mat<f64>, many: &Mat<f64>| {
                let off = (few - many).norm_max();
                assert!(off <= 1e-9 * many.norm_max().max(1.0), "{height} x {width}: {off}");
            };
            let (l11, l21) = panel.blocks();
            let (mut sides, mut many) = ([few.clone()], few.clone());
            panel.eliminate(&mut sides);
            let (mut own, below) = many.as_mut().split_at_row_mut(width);
            solve_lower_triangular_in_place(l11, own.as_mut(), Par::Seq);
            matmul(below, Accum::Add, l21, own.as_ref(), -1.0, Par::Seq);
            compare(&sides[0], &many);
            let (pivots, mut taken) = (few.subrows(0, width).to_owned(), few.clone());
            panel.take_product(pivots.as_ref(), &mut taken);
            let (p, q) = (l11 * &pivots, l21 * &pivots);
            compare(
                &taken,
                &Mat::from_fn(height, 3, |i, k| few[(i, k)] - if i < width { p[(i, k)] } else { q[(i - width, k)] }),
            );
        }
    }
}
