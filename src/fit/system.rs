//! A Newton system over control points and poses, and its factor.
//!
//! ```text
//! M = M0 + U diag(2 s) U^T        M0 sparse: control points and poses;  U the common motions, dense columns, and their
//!                                 springs' stiffness s (`gauge`): three of the gauge, three more for each joined frame
//!   = Mp + W D W^T                Mp = M0 + PIN on one pose,  W = [E, U],  D = diag(-PIN, 2 s)
//! M^-1 = Mp^-1 - V S^-1 V^T       V = Mp^-1 W,  S = D^-1 + W^T V  (Woodbury 1950)
//! ```
//!
//! `M0` alone may be indefinite where the lattice would rather have the whole map elsewhere, which the spring forbids;
//! one pose pinned holds the map as well, sparsely, and is taken back with the spring put in. `M` is positive definite
//! just where `Mp` is and `S` has as many negative eigenvalues as `D` (Haynsworth 1968).

use std::sync::Arc;

use faer::{Mat, MatMut};
use nalgebra::{DMatrix, DVector, Matrix3};

use super::gauge::Motions;
use crate::sparse::{Cholesky, LARGEST_RESIDUAL, Pattern, SparseError, Symmetric, SystemMatrix};

/// The pin's stiffness in units of a pose's prior's root: firm beside what the lattice pulls with, soft beside rounding.
const PIN: f64 = 100.0;
/// Modes of the pin.
const PINS: usize = 3;

/// Gradient and Hessian of an objective.
#[derive(Debug, Clone)]
pub struct System {
    /// By coefficients, then by pose unknowns.
    pub gradient: Vec<f64>,
    /// `M0`.
    pub hessian: SystemMatrix,
    /// `U`, the common motions.
    pub gauge: Motions,
}

impl System {
    pub fn zeros(pattern: Arc<Pattern>, gauge: Motions) -> Self {
        Self { gradient: vec![0.0; pattern.dimension()], hessian: SystemMatrix::zeros(pattern), gauge }
    }

    pub fn clear(&mut self) {
        self.gradient.fill(0.0);
        self.hessian.clear();
    }

    /// `M x`.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut y = self.hessian.times(x);
        let first = self.hessian.pattern().coefficients();
        self.gauge.add_pull(&x[first..], &mut y[first..]);
        y
    }
}

/// A factorisation of a [`System`]'s Hessian, beside the Cholesky factor of `Mp`.
#[derive(Debug, Clone)]
pub struct Factor {
    /// `W` and `V`: unknowns x modes, the pin's, then the common motions'.
    pub(crate) modes: Mat<f64>,
    pub(crate) images: Mat<f64>,
    /// `S^-1`.
    pub(crate) inner: DMatrix<f64>,
    /// `D`.
    stiffness: Vec<f64>,
    /// How many modes are the pin's, and how many the gauge's.
    pins: usize,
    held: usize,
}

impl Factor {
    /// Factorises; `cholesky` then holds the factor of `Mp`, on the system's pattern. An indefinite matrix is an error.
    pub fn factorise(system: &System, cholesky: &mut Cholesky) -> Result<Self, SparseError> {
        let pattern = system.hessian.pattern();
        cholesky.match_pattern(pattern)?;
        let motions = &system.gauge;
        let pins = if motions.held > 0 { PINS } else { 0 };
        let held = pinned(pattern);
        if pins > 0 {
            let mut matrix = system.hessian.clone();
            matrix.add_pose(held, &(Matrix3::identity() * PIN));
            cholesky.factorise(&matrix)?;
        } else {
            cholesky.factorise(&system.hessian)?;
        }
        let (first, n, count) = (pattern.coefficients(), pattern.dimension(), pins + motions.ncols());
        let modes = Mat::from_fn(n, count, |row, mode| match (row.checked_sub(first), mode.checked_sub(pins)) {
            (Some(pose), None) => f64::from(pose == 3 * held + mode),
            (Some(pose), Some(motion)) => motions.columns[(pose, motion)],
            (None, _) => 0.0,
        });
        let stiffness: Vec<f64> =
            (0..count).map(|mode| mode.checked_sub(pins).map_or(-PIN, |k| 2.0 * motions.stiffness(k))).collect();
        let mut images = modes.clone();
        if count == 0 {
            let inner = DMatrix::zeros(0, 0);
            return Ok(Self { modes, images, inner, stiffness, pins, held: motions.held });
        }
        cholesky.solve_block(images.as_mut())?;
        let all: Vec<usize> = (0..count).collect();
        let split = inner_of(&modes, &images, &stiffness, &all);
        let negative = split.symmetric_eigenvalues().iter().filter(|value| **value < 0.0).count();
        let loose = stiffness.iter().filter(|stiffness| **stiffness < 0.0).count();
        match split.try_inverse().filter(|_| negative == loose) {
            Some(inner) => Ok(Self { modes, images, inner, stiffness, pins, held: motions.held }),
            None => Err(SparseError::NotPositiveDefinite),
        }
    }

    /// The gauge's modes.
    pub(crate) fn gauge_modes(&self) -> std::ops::Range<usize> {
        self.pins..self.pins + self.held
    }

    /// Solves `M x = b` in place; unchecked.
    pub fn solve(&self, cholesky: &mut Cholesky, rhs: &mut [f64]) {
        cholesky.solve(rhs);
        if self.modes.ncols() == 0 {
            return;
        }
        let count = self.modes.ncols();
        let along =
            DVector::from_fn(count, |mode, _| rhs.iter().enumerate().map(|(row, x)| self.modes[(row, mode)] * x).sum());
        let share = &self.inner * along;
        for (row, x) in rhs.iter_mut().enumerate() {
            *x -= (0..count).map(|mode| self.images[(row, mode)] * share[mode]).sum::<f64>();
        }
    }

    /// Solves `M X = B` in place for a block of right-hand sides; unchecked.
    pub fn solve_block(&self, cholesky: &Cholesky, mut rhs: MatMut<'_, f64>) -> Result<(), SparseError> {
        use faer::reborrow::ReborrowMut;
        cholesky.solve_block(rhs.rb_mut())?;
        let count = self.modes.ncols();
        if count > 0 {
            let inner = Mat::from_fn(count, count, |a, b| self.inner[(a, b)]);
            let change = &self.images * (inner * (self.modes.transpose() * rhs.as_ref()));
            rhs -= change;
        }
        Ok(())
    }

    /// Solves `M x = b` with one step of refinement, and refuses an answer whose residual is not small.
    pub fn solve_checked(&self, system: &System, cholesky: &mut Cholesky, b: &[f64]) -> Result<Vec<f64>, SparseError> {
        let mut x = b.to_vec();
        self.solve(cholesky, &mut x);
        let mut correction: Vec<f64> = system.times(&x).iter().zip(b).map(|(mx, b)| b - mx).collect();
        self.solve(cholesky, &mut correction);
        x.iter_mut().zip(&correction).for_each(|(x, dx)| *x += dx);
        let largest = |v: &mut dyn Iterator<Item = f64>| {
            v.fold(0.0, |worst: f64, v| if v.is_nan() { f64::INFINITY } else { worst.max(v.abs()) })
        };
        let error = largest(&mut system.times(&x).iter().zip(b).map(|(mx, b)| mx - b));
        let scale = largest(&mut b.iter().copied());
        let residual = if scale > 0.0 { error / scale } else { error };
        if residual <= LARGEST_RESIDUAL { Ok(x) } else { Err(SparseError::Residual { residual }) }
    }

    /// `R = M^-1 (2 + 2 kappa) U` of the gauge: how all unknowns answer a common motion of the reported poses; without
    /// columns where there is no gauge.
    pub fn answer_to_common_motion(&self) -> Option<Mat<f64>> {
        let gauge = self.gauge_modes();
        if gauge.is_empty() {
            return Some(Mat::zeros(self.modes.nrows(), 0));
        }
        // V1 = M1^-1 U, M1 the Hessian without the gauge's springs: the pin is taken back, and frames are loose.
        let others: Vec<usize> = (0..self.modes.ncols()).filter(|mode| !gauge.contains(mode)).collect();
        let inner = inner_of(&self.modes, &self.images, &self.stiffness, &others).try_inverse()?;
        let pick = |from: &Mat<f64>, of: &[usize]| Mat::from_fn(from.nrows(), of.len(), |row, k| from[(row, of[k])]);
        let own: Vec<usize> = gauge.clone().collect();
        let (mut free, modes) = (pick(&self.images, &own), pick(&self.modes, &own));
        let overlap = pick(&self.modes, &others).transpose() * &free;
        let inner = Mat::from_fn(others.len(), others.len(), |a, b| inner[(a, b)]);
        free -= pick(&self.images, &others) * (inner * overlap);
        let own = modes.transpose() * &free;
        let own = Matrix3::from_fn(|a, b| own[(a, b)]);
        let stiff = self.stiffness[gauge.start];
        let share = (Matrix3::identity() + own * stiff).try_inverse()? * (2.0 + stiff);
        Some(free * Mat::from_fn(3, 3, |a, b| share[(a, b)]))
    }
}

/// `D^-1 + W^T V` of some of the modes.
fn inner_of(modes: &Mat<f64>, images: &Mat<f64>, stiffness: &[f64], of: &[usize]) -> DMatrix<f64> {
    let overlap = |a: usize, b: usize| (0..modes.nrows()).map(|row| modes[(row, a)] * images[(row, b)]).sum::<f64>();
    DMatrix::from_fn(of.len(), of.len(), |a, b| {
        let own = 0.5 * (overlap(of[a], of[b]) + overlap(of[b], of[a]));
        own + if a == b { 1.0 / stiffness[of[a]] } else { 0.0 }
    })
}

/// The pose that sees most.
fn pinned(pattern: &Pattern) -> usize {
    let views = pattern.views();
    (0..views.poses()).max_by_key(|&pose| (views.view(pose).len(), std::cmp::Reverse(pose))).unwrap_or(0)
}
