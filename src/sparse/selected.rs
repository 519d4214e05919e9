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

use std::ops::Range;

use faer::{Mat, MatMut, MatRef};

use super::cholesky::Cholesky;
use super::dense::{accumulate, accumulate_lower, inverse, mirror, product, solve_lower_transposed};
use super::division::Division;
use super::error::SparseError;
use super::system::SystemMatrix;
use super::team::Team;
use super::tree::Tree;
use super::walk::{Downward, Front, Sources, Upward, down, up};

/// The entries of `H^-1` on the pattern, `H` being the matrix last factorised.
pub fn selected_inverse(cholesky: &Cholesky, go_on: &dyn Fn(f64) -> bool) -> Result<SystemMatrix, SparseError> {
    let entries = Entries::of(cholesky);
    let pass = Inverse { factor: cholesky.values() };
    let kept = down((cholesky.tree(), cholesky.division()), cholesky.team(), go_on, &pass, &|holder| {
        entries.of_holder(holder)
    })?;
    let [z] = entries.together(kept);
    Ok(z)
}

/// The entries of `H^-1` and of `H^-1 G H^-1` on the pattern, in that order. `go_on` is told how far it is and says
/// whether to go on.
pub fn selected_sandwich(
    cholesky: &Cholesky,
    g: &SystemMatrix,
    go_on: &dyn Fn(f64) -> bool,
) -> Result<(SystemMatrix, SystemMatrix), SparseError> {
    let derivative = eliminate_derivative(cholesky, g, &|share| go_on(SHARE_OF_ELIMINATION * share))?;
    let rest = |share| go_on(SHARE_OF_ELIMINATION + (1.0 - SHARE_OF_ELIMINATION) * share);
    let entries = Entries::of(cholesky);
    let pass = Sandwich { factor: cholesky.values(), derivative: &derivative };
    let kept = down((cholesky.tree(), cholesky.division()), cholesky.team(), &rest, &pass, &|holder| {
        entries.of_holder(holder)
    })?;
    drop(derivative);
    let [z, sandwich] = entries.together(kept);
    Ok((z, sandwich))
}

/// The walk that leaves `Z`.
pub(super) struct Inverse<'f> {
    pub factor: &'f [f64],
}

impl Downward<1> for Inverse<'_> {
    fn visit(&self, tree: &Tree, s: usize, [z22]: [Mat<f64>; 1], [own]: [&mut [f64]; 1], team: &Team) {
        let pivot = Pivot::of(tree, self.factor, s, team);
        let (z21, z11) = inverse_blocks(&pivot, z22.as_ref(), team);
        store(own, z11.as_ref(), z21.as_ref());
    }

    fn sources(&self) -> Sources<'_> {
        Sources { factor: self.factor, derivative: &[] }
    }
}

/// The walk that leaves `Z` and `S`.
pub(super) struct Sandwich<'f> {
    pub factor: &'f [f64],
    /// `G11` and `G21`, as [`Derivative`] leaves them.
    pub derivative: &'f [f64],
}

impl Downward<2> for Sandwich<'_> {
    fn visit(&self, tree: &Tree, s: usize, [z22, s22]: [Mat<f64>; 2], own: [&mut [f64]; 2], team: &Team) {
        let pivot = Pivot::of(tree, self.factor, s, team);
        let (z21, z11) = inverse_blocks(&pivot, z22.as_ref(), team);

        let (g11, g21) = tree.blocks(s, &self.derivative[tree.span(s..s + 1)]);
        let mut e = g21.to_owned();
        accumulate(e.as_mut(), pivot.m.as_ref(), g11, -1.0, team);
        let dm = product(e.as_ref(), pivot.w.as_ref(), 1.0, team);
        let mut s21 = product(z22.as_ref(), dm.as_ref(), 1.0, team);
        accumulate(s21.as_mut(), s22.as_ref(), pivot.m.as_ref(), -1.0, team);
        let wg = product(pivot.w.as_ref(), g11, 1.0, team);
        let mut s11 = Mat::zeros(wg.nrows(), wg.ncols());
        accumulate_lower(s11.as_mut(), wg.as_ref(), pivot.w.as_ref(), 1.0, team);
        accumulate_lower(s11.as_mut(), dm.transpose(), z21.as_ref(), 1.0, team);
        accumulate_lower(s11.as_mut(), pivot.m.transpose(), s21.as_ref(), -1.0, team);
        mirror(s11.as_mut());

        let [own_z, own_s] = own;
        store(own_z, z11.as_ref(), z21.as_ref());
        store(own_s, s11.as_ref(), s21.as_ref());
    }

    fn sources(&self) -> Sources<'_> {
        Sources { factor: self.factor, derivative: self.derivative }
    }
}

/// A supernode's `M = L21 L11^-1` and `W = (L11 L11^T)^-1`.
struct Pivot {
    m: Mat<f64>,
    w: Mat<f64>,
}

impl Pivot {
    fn of(tree: &Tree, factor: &[f64], s: usize, team: &Team) -> Self {
        let (l11, l21) = tree.blocks(s, &factor[tree.span(s..s + 1)]);
        let mut m_transposed = l21.transpose().to_owned();
        solve_lower_transposed(l11, m_transposed.as_mut(), team);
        Self { m: m_transposed.transpose().to_owned(), w: inverse(l11, team) }
    }
}

fn inverse_blocks(pivot: &Pivot, z22: MatRef<'_, f64>, team: &Team) -> (Mat<f64>, Mat<f64>) {
    let z21 = product(z22, pivot.m.as_ref(), -1.0, team);
    let mut z11 = pivot.w.clone();
    accumulate_lower(z11.as_mut(), pivot.m.transpose(), z21.as_ref(), -1.0, team);
    mirror(z11.as_mut());
    (z21, z11)
}

/// The derivative of the elimination along `G`: per supernode `G11` and `G21` as they stand when it is eliminated.
pub(super) fn eliminate_derivative(
    cholesky: &Cholesky,
    g: &SystemMatrix,
    go_on: &dyn Fn(f64) -> bool,
) -> Result<Vec<f64>, SparseError> {
    let (tree, steps) = (cholesky.tree(), cholesky.steps());
    let mut values = vec![0.0; cholesky.fill()];
    let sources = g.pattern().entries().map(|(_, _, source)| source);
    cholesky.addresses().iter().zip(sources).for_each(|(at, source)| values[*at as usize] = g.values()[source]);
    for (row, column, value) in g.pair_entries() {
        values[tree.address(steps[row], steps[column])] = value;
    }
    up((tree, cholesky.division()), &mut values, cholesky.team(), go_on, &Derivative { factor: cholesky.values() })?;
    Ok(values)
}

/// The walk that leaves the elimination's derivative.
pub(super) struct Derivative<'f> {
    pub factor: &'f [f64],
}

impl Upward for Derivative<'_> {
    fn visit(&self, tree: &Tree, Front { s, panel, below, team }: Front<'_>) -> Result<(), SparseError> {
        let (width, height) = (tree.width(s), tree.height(s));
        mirror(MatMut::from_column_major_slice_mut(panel, height, width).split_at_row_mut(width).0);
        if height == width {
            return Ok(());
        }
        let pivot = Pivot::of(tree, self.factor, s, team);
        let (g11, g21) = tree.blocks(s, panel);
        let mut e = g21.to_owned();
        accumulate(e.as_mut(), pivot.m.as_ref(), g11, -1.0, team);
        accumulate_lower(below.as_mut(), e.as_ref(), pivot.m.transpose(), -1.0, team);
        accumulate_lower(below.as_mut(), pivot.m.as_ref(), g21.transpose(), -1.0, team);
        Ok(())
    }

    fn sources(&self) -> Sources<'_> {
        Sources { factor: self.factor, derivative: &[] }
    }
}

/// The share of a sandwich's work that is its first half's.
const SHARE_OF_ELIMINATION: f64 = 0.3;

fn store(panel: &mut [f64], pivot: MatRef<'_, f64>, below: MatRef<'_, f64>) {
    let (width, height) = (pivot.ncols(), pivot.nrows() + below.nrows());
    let (mut top, mut bottom) = MatMut::from_column_major_slice_mut(panel, height, width).split_at_row_mut(width);
    top.copy_from(pivot);
    bottom.copy_from(below);
}

/// The entries on a system's own pattern, which the factor's contains, by who holds them: the branches in their order,
/// then each supernode of the top.
struct Entries<'a> {
    cholesky: &'a Cholesky,
    /// The first supernode, and where the holder's panels lie.
    holders: Vec<(usize, Range<usize>)>,
    /// By holder, in the pattern's order, among its own values.
    places: Vec<Vec<u32>>,
}

impl<'a> Entries<'a> {
    fn of(cholesky: &'a Cholesky) -> Self {
        let tree = cholesky.tree();
        let Division { branches, top } = cholesky.division();
        let holders = branches.iter().cloned().chain(top.iter().map(|&s| s..s + 1));
        let holders: Vec<_> = holders.map(|own| (own.start, tree.span(own))).collect();
        let mut entries = Self { cholesky, places: vec![Vec::new(); holders.len()], holders };
        let mut places = std::mem::take(&mut entries.places);
        // Addresses are of 32 bits, so places among a holder's own values are.
        entries.each(|holder, address| places[holder].push(address - entries.holders[holder].1.start as u32));
        Self { places, ..entries }
    }

    /// Tells every entry's holder and address, in the pattern's order.
    fn each(&self, mut told: impl FnMut(usize, u32)) {
        let mut order: Vec<usize> = (0..self.holders.len()).collect();
        order.sort_by_key(|&holder| self.holders[holder].1.start);
        let mut last = 0;
        for &address in self.cholesky.addresses() {
            let at = address as usize;
            if !self.holders.get(last).is_some_and(|(_, span)| span.contains(&at)) {
                let after = order.partition_point(|&holder| self.holders[holder].1.start <= at);
                last = order[after.saturating_sub(1)];
            }
            told(last, address);
        }
    }

    /// Where the entries of these supernodes, a branch or one of the top, lie among their values.
    fn of_holder(&self, supernodes: Range<usize>) -> &[u32] {
        let holder = self.holders.iter().position(|(start, _)| *start == supernodes.start);
        holder.map_or(&[], |holder| &self.places[holder])
    }

    /// The matrices, of what all holders have.
    fn together<const K: usize>(&self, kept: Vec<Vec<[f64; K]>>) -> [SystemMatrix; K] {
        let pattern = self.cholesky.pattern();
        let mut matrices = std::array::from_fn(|_| SystemMatrix::zeros(pattern.clone()));
        let mut own: Vec<_> = kept.iter().map(|values| values.iter()).collect();
        let mut sources = pattern.entries().map(|(_, _, source)| source);
        self.each(|holder, _| {
            let (Some(source), Some(values)) = (sources.next(), own[holder].next()) else { return };
            matrices.iter_mut().zip(values).for_each(|(matrix, value)| matrix.set(source, *value));
        });
        matrices
    }
}

#[cfg(test)]
pub(super) mod tests {
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
    pub fn random_spd(pattern: &std::sync::Arc<Pattern>, seed: u64, ridge: f64) -> SystemMatrix {
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

    /// Two components of a place that poses see: some a spot each, one all of it, and a crowd in a corner.
    pub fn seen_place() -> std::sync::Arc<Pattern> {
        let size: [usize; 2] = [41, 30];
        let near = |pose: usize| (0..size[0] * size[1]).filter(move |&p| (p % 41).abs_diff(5 * pose) <= 5);
        let corner = |p: &usize| p % 41 < 8 && p / 41 < 8;
        let everywhere = (0..size[0] * size[1]).map(|p| (8, p));
        let crowd = (9..60).flat_map(|pose| (0..size[0] * size[1]).filter(corner).map(move |p| (pose, p)));
        let views = (0..8).flat_map(|pose| near(pose).map(move |p| (pose, p))).chain(everywhere).chain(crowd);
        Pattern::new(Stencil::of_grid(size), 2, Views::of(60, views))
    }

    #[test]
    fn branches_are_anyones_and_the_bytes_the_same() {
        let pattern = seen_place();
        let (h, g) = (random_spd(&pattern, 5, 0.3), random_spd(&pattern, 105, 0.0));
        let dense = h.to_dense().llt(faer::Side::Lower).unwrap().inverse();
        let all = [(1, 2), (3, 2), (6, 6)].map(|(threads, least)| {
            let team = Team::of(std::num::NonZero::new(threads).unwrap());
            let mut cholesky = Cholesky::analyse(&pattern).unwrap().with_team(team);
            let branches = cholesky.division().branches.len();
            assert!(branches >= least, "{branches} of {:?}", pattern.branches());
            assert!(cholesky.tree().whole_work() > 5e7, "too small to be shared");
            cholesky.factorise(&h).unwrap();
            let mut x: Vec<f64> = (0..pattern.dimension()).map(|k| (k as f64).cos()).collect();
            cholesky.solve(&mut x);
            let (z, s) = selected_sandwich(&cholesky, &g, &|_| true).unwrap();
            assert!(worst_difference(&z, &dense) < 1e-10);
            (x, z.values().to_vec(), s.values().to_vec())
        });
        assert!(all[1] == all[0] && all[2] == all[0]);
    }

    #[test]
    fn a_walk_told_to_stop_stops() {
        let pattern = Pattern::new(Stencil::of_grid([60, 60]), 1, Views::of(0, []));
        let mut cholesky = Cholesky::analyse(&pattern).unwrap();
        cholesky.factorise(&random_spd(&pattern, 7, 0.3)).unwrap();
        assert_eq!(selected_inverse(&cholesky, &|_| false).err(), Some(SparseError::Stopped));
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
