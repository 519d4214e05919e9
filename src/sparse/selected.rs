//! Entries of the inverse on the factor's pattern, without the inverse (Takahashi, Fagan, Chen 1973).
//!
//! For a supernode with pivot block `F11`, the rows below it `F21 = M F11`, and `Z = H^-1`:
//!
//! ```text
//! W = F11^-1,  Z21 = -Z22 M,  Z11 = W - M^T Z21
//! ```
//!
//! where `Z22`, between the rows below, lies in supernodes eliminated later. So one walk from the last supernode to the
//! first gives every entry of `H^-1` on the pattern of `L`, which contains every pair of control points that share a
//! cell.
//!
//! The propagated covariance is `S = H^-1 G H^-1` with `G` on the pattern of `H`. Because
//! `S = -d/dt (H + t G)^-1` at `t = 0`, the same recursion carried in dual numbers gives its entries exactly:
//! first the derivative of the elimination, from the first supernode to the last,
//!
//! ```text
//! E = G21 - M G11,  dM = E W,  G22 <- G22 - E M^T - M G21^T
//! ```
//!
//! then, with `Z`, from the last to the first,
//!
//! ```text
//! S21 = Z22 dM - S22 M,  S11 = W G11 W + dM^T Z21 - M^T S21
//! ```

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLltRef, SymbolicSupernodalCholesky};
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::cholesky::Cholesky;
use super::error::SparseError;
use super::panels::Panels;
use super::system::SystemMatrix;

/// The entries of `H^-1` on the pattern, `H` being the matrix last factorised.
pub fn selected_inverse(cholesky: &Cholesky, go_on: &dyn Fn(f64) -> bool) -> Result<SystemMatrix, SparseError> {
    let (factor, inverse) = cholesky.supernodes()?;
    let symbolic = factor.symbolic();
    let mut z = Panels::zeros(symbolic);
    let mut pace = Pace::of(symbolic, go_on);
    for s in (0..symbolic.n_supernodes()).rev() {
        pace.step(s)?;
        let pivot = Pivot::of(factor, s);
        let z22 = z.trailing(s);
        let (z21, z11) = inverse_blocks(&pivot, z22.as_ref());
        z.store(s, z11.as_ref(), z21.as_ref());
    }
    Ok(z.on_pattern(cholesky, inverse))
}

/// The entries of `H^-1` and of `H^-1 G H^-1` on the pattern, in that order. `go_on` is told how far it is and says
/// whether to go on.
pub fn selected_sandwich(
    cholesky: &Cholesky,
    g: &SystemMatrix,
    go_on: &dyn Fn(f64) -> bool,
) -> Result<(SystemMatrix, SystemMatrix), SparseError> {
    let (factor, inverse) = cholesky.supernodes()?;
    let symbolic = factor.symbolic();
    let eliminated = eliminate_derivative(factor, g, inverse, &|share| go_on(SHARE_OF_ELIMINATION * share))?;
    let rest = |share| go_on(SHARE_OF_ELIMINATION + (1.0 - SHARE_OF_ELIMINATION) * share);
    let mut pace = Pace::of(symbolic, &rest);
    let (mut z, mut s_panels) = (Panels::zeros(symbolic), Panels::zeros(symbolic));
    for s in (0..symbolic.n_supernodes()).rev() {
        pace.step(s)?;
        let pivot = Pivot::of(factor, s);
        let (z22, s22) = (z.trailing(s), s_panels.trailing(s));
        let (z21, z11) = inverse_blocks(&pivot, z22.as_ref());

        let (g11, g21) = eliminated.blocks(s);
        let mut e = g21.to_owned();
        accumulate(e.as_mut(), pivot.m.as_ref(), g11, -1.0);
        let dm = product(e.as_ref(), pivot.w.as_ref(), 1.0);
        let mut s21 = product(z22.as_ref(), dm.as_ref(), 1.0);
        accumulate(s21.as_mut(), s22.as_ref(), pivot.m.as_ref(), -1.0);
        let wg = product(pivot.w.as_ref(), g11, 1.0);
        let mut s11 = product(wg.as_ref(), pivot.w.as_ref(), 1.0);
        accumulate_lower(s11.as_mut(), dm.transpose(), z21.as_ref(), 1.0);
        accumulate_lower(s11.as_mut(), pivot.m.transpose(), s21.as_ref(), -1.0);
        mirror(s11.as_mut());

        z.store(s, z11.as_ref(), z21.as_ref());
        s_panels.store(s, s11.as_ref(), s21.as_ref());
    }
    Ok((z.on_pattern(cholesky, inverse), s_panels.on_pattern(cholesky, inverse)))
}

/// A supernode's `M = L21 L11^-1` and `W = (L11 L11^T)^-1`.
struct Pivot {
    m: Mat<f64>,
    w: Mat<f64>,
}

impl Pivot {
    fn of(factor: SupernodalLltRef<'_, usize, f64>, s: usize) -> Self {
        let panel = factor.supernode(s).val();
        let (l11, l21) = panel.split_at_row(panel.ncols());
        let mut m_transposed = l21.transpose().to_owned();
        solve_upper_triangular_in_place(l11.transpose(), m_transposed.as_mut(), Par::Seq);
        let mut l11_inverse = Mat::<f64>::identity(panel.ncols(), panel.ncols());
        solve_lower_triangular_in_place(l11, l11_inverse.as_mut(), Par::Seq);
        let w = product(l11_inverse.transpose(), l11_inverse.as_ref(), 1.0);
        Self { m: m_transposed.transpose().to_owned(), w }
    }
}

fn inverse_blocks(pivot: &Pivot, z22: MatRef<'_, f64>) -> (Mat<f64>, Mat<f64>) {
    let z21 = product(z22, pivot.m.as_ref(), -1.0);
    let mut z11 = pivot.w.clone();
    accumulate_lower(z11.as_mut(), pivot.m.transpose(), z21.as_ref(), -1.0);
    mirror(z11.as_mut());
    (z21, z11)
}

/// The derivative of the elimination along `G`: per supernode `G11` and `G21` as they stand when it is eliminated.
pub(super) fn eliminate_derivative<'a>(
    factor: SupernodalLltRef<'a, usize, f64>,
    g: &SystemMatrix,
    inverse: &[usize],
    go_on: &dyn Fn(f64) -> bool,
) -> Result<Panels<'a>, SparseError> {
    let symbolic = factor.symbolic();
    let supernodes = symbolic.n_supernodes();
    let mut panels = Panels::zeros(symbolic);
    panels.scatter(g, inverse);
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); supernodes];
    let mut updates: Vec<Option<Mat<f64>>> = (0..supernodes).map(|_| None).collect();
    let mut pace = Pace::of(symbolic, go_on);
    for s in 0..supernodes {
        pace.step(s)?;
        let rows = panels.rows(s);
        let mut g22 = Mat::<f64>::zeros(rows.len() - panels.width(s), rows.len() - panels.width(s));
        for child in std::mem::take(&mut children[s]) {
            if let Some(update) = updates[child].take() {
                panels.extend_add(s, &mut g22, child, update.as_ref());
            }
        }
        mirror(panels.blocks_mut(s).0);
        let Some(&first_below) = symbolic.supernode(s).pattern().first() else { continue };
        let pivot = Pivot::of(factor, s);
        let (g11, g21) = panels.blocks(s);
        let mut e = g21.to_owned();
        accumulate(e.as_mut(), pivot.m.as_ref(), g11, -1.0);
        accumulate_lower(g22.as_mut(), e.as_ref(), pivot.m.transpose(), -1.0);
        accumulate_lower(g22.as_mut(), pivot.m.as_ref(), g21.transpose(), -1.0);
        updates[s] = Some(g22);
        children[panels.owner[first_below]].push(s);
    }
    Ok(panels)
}

/// The share of a sandwich's work that is its first half's.
const SHARE_OF_ELIMINATION: f64 = 0.3;
/// Work between two questions whether to go on, in multiply-adds.
const BREATH: f64 = 1e8;

/// Tells how far a walk over the supernodes is, in proportion to the work, and asks whether to go on.
struct Pace<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<usize>,
    go_on: &'a dyn Fn(f64) -> bool,
    done: f64,
    told: f64,
    whole: f64,
}

impl<'a> Pace<'a> {
    fn of(symbolic: &'a SymbolicSupernodalCholesky<usize>, go_on: &'a dyn Fn(f64) -> bool) -> Self {
        let whole = (0..symbolic.n_supernodes()).map(|s| Self::work(symbolic, s)).sum();
        Self { symbolic, go_on, done: 0.0, told: 0.0, whole }
    }

    fn work(symbolic: &SymbolicSupernodalCholesky<usize>, s: usize) -> f64 {
        let width = (symbolic.supernode_end()[s] - symbolic.supernode_begin()[s]) as f64;
        width * (width + symbolic.supernode(s).pattern().len() as f64).powi(2)
    }

    fn step(&mut self, s: usize) -> Result<(), SparseError> {
        self.done += Self::work(self.symbolic, s);
        if self.done - self.told < BREATH {
            return Ok(());
        }
        self.told = self.done;
        if (self.go_on)(self.done / self.whole) { Ok(()) } else { Err(SparseError::Stopped) }
    }
}

fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    matmul(out.as_mut(), Accum::Replace, a, b, scale, Par::Seq);
    out
}

fn accumulate(into: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64) {
    matmul(into, Accum::Add, a, b, scale, Par::Seq);
}

/// Adds the lower triangle of a product that is symmetric, alone or with others.
fn accumulate_lower(into: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64) {
    let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
    triangular::matmul(into, lower, Accum::Add, a, whole, b, whole, scale, Par::Seq);
}

/// Copies the lower triangle to the upper.
fn mirror(mut square: MatMut<'_, f64>) {
    for column in 0..square.ncols() {
        for row in column + 1..square.nrows() {
            square[(column, row)] = square[(row, column)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::{CellBlock, Pattern, Stencil, Symmetric, Views};
    use crate::spline::SUPPORT;
    use faer::linalg::solvers::DenseSolveCore;
    use nalgebra::{Matrix3, Vector3};
    use rand::{RngExt, SeedableRng};

    fn worst_difference(selected: &SystemMatrix, dense: &Mat<f64>) -> f64 {
        let scale = (0..dense.nrows()).map(|k| dense[(k, k)].abs()).fold(0.0, f64::max);
        let entries = selected.pattern().entries();
        entries.map(|(p, q, at)| (selected.values()[at] - dense[(p, q)]).abs() / scale).fold(0.0, f64::max)
    }

    /// A sum of outer products of rows that touch one cell, of all components, and one pose that sees it.
    fn random_spd(pattern: &std::sync::Arc<Pattern>, seed: u64, ridge: f64) -> SystemMatrix {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut matrix = SystemMatrix::zeros(pattern.clone());
        let [nx, ny] = pattern.stencil().size();
        let components = pattern.components();
        for (i, j) in (0..ny - 3).flat_map(|j| (0..nx - 3).map(move |i| (i, j))) {
            let first = i + j * nx;
            let support: [usize; SUPPORT] = std::array::from_fn(|k| first + k % 4 + k / 4 * nx);
            let v: [f64; SUPPORT] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
            let n: Vec<f64> = (0..components).map(|_| rng.random_range(-1.0..1.0)).collect();
            let square = CellBlock::symmetric_product(&v, &v);
            for (a, b) in (0..components).flat_map(|a| (0..components).map(move |b| (a, b))) {
                let mut block = CellBlock::ZERO;
                block.add_scaled(n[a] * n[b], &square);
                matrix.add_cell((a, b), first, &block);
            }
            let seen = (0..pattern.views().poses())
                .filter(|&pose| [first, support[15]].iter().all(|&p| pattern.views().position(pose, p).is_some()));
            if let Some(pose) = seen.max_by_key(|pose| (pose * 7 + i + j) % 5) {
                let own = Vector3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.3);
                (0..components).for_each(|k| matrix.add_coupling((k, pose), &support, |at| own * (n[k] * v[at])));
                matrix.add_pose(pose, &(own * own.transpose()));
            }
        }
        matrix.shift_diagonal(|_, _| ridge);
        (0..pattern.views().poses()).for_each(|pose| matrix.add_pose(pose, &(Matrix3::identity() * ridge)));
        matrix
    }

    #[test]
    fn both_agree_with_dense_inverses_with_poses_and_without() {
        for (size, components, poses, seed) in
            [([4, 4], 1, 0, 0), ([9, 13], 2, 3, 1), ([21, 18], 1, 5, 2), ([22, 9], 2, 4, 3)]
        {
            let stencil = Stencil::of_grid(size);
            let n = size[0] * size[1];
            // Each pose sees a band of whole cells.
            let band = |pose: usize| (0..n).filter(move |p| (p / size[0]).abs_diff(2 * pose + 2) <= 3);
            let views = Views::of(poses, (0..poses).flat_map(|pose| band(pose).map(move |p| (pose, p))));
            let pattern = Pattern::new(stencil, components, views);
            let (h, g) = (random_spd(&pattern, seed, 0.3), random_spd(&pattern, seed + 100, 0.0));
            let mut cholesky = Cholesky::analyse(&pattern).unwrap();
            cholesky.factorise(&h).unwrap();
            let go_on = |_: f64| true;
            let (z, s) = selected_sandwich(&cholesky, &g, &go_on).unwrap();
            let dense = h.to_dense().partial_piv_lu().inverse();
            let sandwich = &dense * g.to_dense() * &dense;
            assert!(worst_difference(&z, &dense) < 1e-10, "inverse of {size:?}");
            assert!(worst_difference(&s, &sandwich) < 1e-10, "sandwich of {size:?}");
            assert_eq!(selected_inverse(&cholesky, &go_on).unwrap().values(), z.values());
            let x: Vec<f64> = (0..pattern.dimension()).map(|k| (k as f64).sin()).collect();
            let product = h.to_dense() * Mat::from_fn(x.len(), 1, |k, _| x[k]);
            assert!(h.times(&x).iter().enumerate().all(|(k, y)| (y - product[(k, 0)]).abs() < 1e-10));
        }
    }
}
