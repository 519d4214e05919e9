//! Sparse Cholesky factorisation of matrices on a [`Pattern`], `P H P^T = L L^T`.
//!
//! faer's symbolic analysis under the pattern's geometric order, done once. The factorisation is multifrontal (`walk`),
//! with faer's dense kernels on every front:
//!
//! ```text
//! F11 = L11 L11^T,  L21 = F21 L11^-T,  F22 <- F22 - L21 L21^T
//! ```
//!
//! so that branches of the elimination tree can be a team's, which faer's own factorisation, one supernode after another
//! from the left, does not allow. The factor's values are allocated once and reused by every step.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::reborrow::ReborrowMut;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::{Conj, MatMut, Par, Side};

use super::dense::{accumulate_lower, factorise};
use super::division::Division;
use super::error::{LARGEST_FACTOR, SparseError};
use super::pattern::Pattern;
use super::system::Symmetric;
use super::team::Team;
use super::tree::Tree;
use super::walk::{Front, Upward, up};

/// How large a relative residual of a solve may be before its answer is refused.
pub(crate) const LARGEST_RESIDUAL: f64 = 1e-6;

/// A factorisation with its buffers; make one per pattern and refill it.
pub struct Cholesky {
    pattern: Arc<Pattern>,
    symbolic: SymbolicCholesky<usize>,
    tree: Tree,
    division: Division,
    /// Where the pattern's entries lie among the values.
    addresses: Vec<u32>,
    values: Vec<f64>,
    scratch: MemBuffer,
    team: Team,
}

impl Cholesky {
    /// The symbolic analysis for a pattern; no values yet.
    pub fn analyse(pattern: &Arc<Pattern>) -> Result<Self, SparseError> {
        let order = pattern.order();
        let mut inverse = vec![0; order.len()];
        for (step, &unknown) in order.iter().enumerate() {
            inverse[unknown] = step;
        }
        let permutation = PermRef::new_checked(order, &inverse, order.len());
        // Supernodes are what the selected inverse walks, so the simplicial variant is never chosen.
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let setup = |error: &dyn std::fmt::Debug| SparseError::Setup(format!("{error:?}"));
        let symbolic = factorize_symbolic_cholesky(
            pattern.symbolic(),
            Side::Lower,
            SymmetricOrdering::Custom(permutation),
            params,
        )
        .map_err(|error| setup(&error))?;
        if symbolic.len_val() > LARGEST_FACTOR {
            return Err(SparseError::TooMuchFill { entries: symbolic.len_val(), limit: LARGEST_FACTOR });
        }
        let need = symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        let scratch = MemBuffer::try_new(need).map_err(|error| setup(&error))?;
        let SymbolicCholeskyRaw::Supernodal(supernodal) = symbolic.raw() else {
            return Err(SparseError::Setup("the factor has no supernodes".into()));
        };
        let tree = Tree::of(supernodal);
        let division = Division::fine(&tree, pattern.branches());
        // A factor's entries are fewer than 2^32: see `LARGEST_FACTOR`.
        let address = |(row, column, _): (usize, usize, usize)| tree.address(inverse[row], inverse[column]) as u32;
        let addresses = pattern.entries().map(address).collect();
        let values = vec![0.0; symbolic.len_val()];
        Ok(Self {
            pattern: pattern.clone(),
            symbolic,
            tree,
            division,
            addresses,
            values,
            scratch,
            team: Team::default(),
        })
    }

    /// With a team that factorises, and inverts what it factorised.
    pub fn with_team(self, team: Team) -> Self {
        let division = match team.is_small() {
            true => Division::coarse(&self.tree),
            false => Division::fine(&self.tree, self.pattern.branches()),
        };
        Self { team, division, ..self }
    }

    pub(super) fn team(&self) -> &Team {
        &self.team
    }

    /// Turns to another pattern, if this is not the one; the team stays.
    pub fn match_pattern(&mut self, pattern: &Arc<Pattern>) -> Result<(), SparseError> {
        if !Arc::ptr_eq(&self.pattern, pattern) {
            *self = Self::analyse(pattern)?.with_team(self.team.clone());
        }
        Ok(())
    }

    /// Factorises a matrix on the pattern this was made for.
    pub fn factorise(&mut self, matrix: &impl Symmetric) -> Result<(), SparseError> {
        let mut values = std::mem::take(&mut self.values);
        values.fill(0.0);
        self.addresses.iter().zip(matrix.lower()).for_each(|(at, value)| values[*at as usize] = value);
        let outcome = up((&self.tree, &self.division), &mut values, &self.team, &|_| true, &Elimination);
        self.values = values;
        outcome
    }

    /// The number of unknowns.
    pub fn dimension(&self) -> usize {
        self.pattern.dimension()
    }

    /// The pattern this factorises.
    pub fn pattern(&self) -> &Arc<Pattern> {
        &self.pattern
    }

    /// Whether the factor holds an entry between two unknowns.
    pub fn holds(&self, a: usize, b: usize) -> bool {
        let (steps, tree) = (self.steps(), &self.tree);
        let (first, last) = (steps[a].min(steps[b]), steps[a].max(steps[b]));
        let s = tree.owner()[first];
        tree.owner()[last] == s || tree.below(s).binary_search(&last).is_ok()
    }

    /// The number of stored entries of the factor.
    pub fn fill(&self) -> usize {
        self.values.len()
    }

    /// Bytes that the factor and the places of its pattern's entries hold.
    pub(super) fn held_bytes(&self) -> usize {
        8 * self.values.len() + 4 * self.addresses.len()
    }

    /// `log det H` of the matrix last factorised.
    pub fn log_determinant(&self) -> f64 {
        2.0 * self.pivots().map(f64::ln).sum::<f64>()
    }

    /// Solves `H x = b` in place for one right-hand side, without a check: see [`Cholesky::solve_checked`].
    pub fn solve(&mut self, rhs: &mut [f64]) {
        let n = rhs.len();
        let factor = LltRef::new(&self.symbolic, &self.values);
        let rhs = MatMut::from_column_major_slice_mut(rhs, n, 1);
        factor.solve_in_place_with_conj(Conj::No, rhs, Par::Seq, MemStack::new(&mut self.scratch));
    }

    /// Solves `H x = b` and checks the residual against `matrix`, the one that was factorised.
    ///
    /// One step of iterative refinement repairs what rounding lost; a residual that is still not small is an error,
    /// never a silent answer.
    pub fn solve_checked(&mut self, matrix: &impl Symmetric, b: &[f64]) -> Result<Vec<f64>, SparseError> {
        let mut x = b.to_vec();
        self.solve(&mut x);
        let mut correction: Vec<f64> = matrix.times(&x).iter().zip(b).map(|(hx, b)| b - hx).collect();
        self.solve(&mut correction);
        x.iter_mut().zip(&correction).for_each(|(x, dx)| *x += dx);
        let residual = relative_residual(matrix, &x, b);
        if residual <= LARGEST_RESIDUAL { Ok(x) } else { Err(SparseError::Residual { residual }) }
    }

    /// Solves `H X = B` in place for a block of right-hand sides.
    pub fn solve_block(&self, rhs: MatMut<'_, f64>) -> Result<(), SparseError> {
        let need = self.symbolic.solve_in_place_scratch::<f64>(rhs.ncols(), Par::Seq);
        let mut scratch = MemBuffer::try_new(need).map_err(|error| SparseError::Setup(format!("{error:?}")))?;
        let factor = LltRef::new(&self.symbolic, &self.values);
        factor.solve_in_place_with_conj(Conj::No, rhs, Par::Seq, MemStack::new(&mut scratch));
        Ok(())
    }

    /// The factor's values, panel after panel.
    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    /// The step at which each unknown is eliminated.
    pub(super) fn steps(&self) -> &[usize] {
        self.symbolic.perm().map_or(&[], |perm| perm.arrays().1)
    }

    /// Where the pattern's entries lie among the factor's, in their order.
    pub(super) fn addresses(&self) -> &[u32] {
        &self.addresses
    }

    /// Where its entries lie.
    pub(super) fn tree(&self) -> &Tree {
        &self.tree
    }

    /// How it is divided among those who factorise.
    pub(super) fn division(&self) -> &Division {
        &self.division
    }

    fn pivots(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.tree.supernodes()).flat_map(move |s| {
            let panel = &self.values[self.tree.span(s..s + 1)];
            (0..self.tree.width(s)).map(move |k| panel[k * (self.tree.height(s) + 1)])
        })
    }
}

/// A walk that leaves the factor; see the module.
pub(super) struct Elimination;

impl Upward for Elimination {
    fn visit(&self, tree: &Tree, Front { s, panel, below, team }: Front<'_>) -> Result<(), SparseError> {
        let (width, height) = (tree.width(s), tree.height(s));
        let mut own = MatMut::from_column_major_slice_mut(panel, height, width);
        factorise(own.rb_mut(), team)?;
        let l21 = own.as_ref().subrows(width, height - width);
        accumulate_lower(below.as_mut(), l21, l21.transpose(), -1.0, team);
        Ok(())
    }
}

/// `|H x - b| / |b|` in the largest entry.
pub(crate) fn relative_residual(matrix: &impl Symmetric, x: &[f64], b: &[f64]) -> f64 {
    let largest = |worst: f64, v: f64| if v.is_nan() { f64::INFINITY } else { worst.max(v.abs()) };
    let scale = b.iter().copied().fold(0.0, largest);
    let error = matrix.times(x).iter().zip(b).map(|(hx, b)| hx - b).fold(0.0, largest);
    if scale > 0.0 { error / scale } else { error }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::sparse::{CellBlock, Pattern, Stencil, StencilMatrix};
    use crate::spline::SUPPORT;
    use rand::{RngExt, SeedableRng};

    /// A random positive definite matrix on a stencil: a sum of cell-wise outer products.
    pub fn random_spd(size: [usize; 2], seed: u64) -> StencilMatrix {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut matrix = StencilMatrix::zeros(Stencil::of_grid(size));
        for j in 0..size[1] - 3 {
            for i in 0..size[0] - 3 {
                for _ in 0..2 {
                    let v: [f64; SUPPORT] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
                    matrix.add_cell(i + j * size[0], &CellBlock::symmetric_product(&v, &v));
                }
            }
        }
        matrix.shift_diagonal(|_| 0.3);
        matrix
    }

    #[test]
    fn a_solve_meets_its_right_hand_side() {
        let matrix = random_spd([23, 17], 3);
        let mut cholesky = Cholesky::analyse(&Pattern::of_stencil(matrix.stencil())).unwrap();
        cholesky.factorise(&matrix).unwrap();
        let b: Vec<f64> = (0..23 * 17).map(|k| (k as f64).sin()).collect();
        let x = cholesky.solve_checked(&matrix, &b).unwrap();
        assert!(relative_residual(&matrix, &x, &b) < 1e-12);
    }

    #[test]
    fn an_indefinite_matrix_and_a_nan_are_refused() {
        let mut matrix = random_spd([9, 9], 5);
        let mut cholesky = Cholesky::analyse(&Pattern::of_stencil(matrix.stencil())).unwrap();
        matrix.shift_diagonal(|k| if k == 40 { -1e3 } else { 0.0 });
        assert_eq!(cholesky.factorise(&matrix), Err(SparseError::NotPositiveDefinite));
        matrix.values.fill(f64::NAN);
        assert_eq!(cholesky.factorise(&matrix), Err(SparseError::NotPositiveDefinite));
    }

    #[test]
    fn the_log_determinant_is_that_of_the_dense_factor() {
        let matrix = random_spd([8, 7], 1);
        let mut cholesky = Cholesky::analyse(&Pattern::of_stencil(matrix.stencil())).unwrap();
        cholesky.factorise(&matrix).unwrap();
        let dense = matrix.to_dense();
        let exact: f64 = dense.llt(Side::Lower).unwrap().L().diagonal().column_vector().iter().map(|l| l.ln()).sum();
        assert!((cholesky.log_determinant() - 2.0 * exact).abs() < 1e-9);
    }
}
