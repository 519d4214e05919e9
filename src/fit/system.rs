//! A Newton system over control points and poses, and its factor.
//!
//! ```text
//! M = M0 + 2 kappa U U^T          M0 sparse: control points and poses;  U the gauge, three dense columns (`gauge`)
//!   = Mp + W D W^T                Mp = M0 + PIN on one pose,  W = [E, U],  D = diag(-PIN, 2 kappa)
//! M^-1 = Mp^-1 - V S^-1 V^T       V = Mp^-1 W,  S = D^-1 + W^T V  (Woodbury 1950)
//! ```
//!
//! `M0` alone may be indefinite where the lattice would rather have the whole map elsewhere, which the spring forbids;
//! one pose pinned holds the map as well, sparsely, and is taken back with the spring put in. `M` is positive definite
//! just where `Mp` is and `S` has as many negative eigenvalues as `D` (Haynsworth 1968).

use std::sync::Arc;

use faer::{Mat, MatMut};
use nalgebra::{Matrix3, SMatrix};

use super::gauge;
use crate::sparse::{Cholesky, LARGEST_RESIDUAL, Pattern, SparseError, Symmetric, SystemMatrix};

/// The pin's stiffness in units of a pose's prior's root: firm beside what the lattice pulls with, soft beside rounding.
const PIN: f64 = 100.0;
/// Modes of the pin and of the gauge.
const MODES: usize = 6;

/// Gradient and Hessian of an objective.
#[derive(Debug, Clone)]
pub struct System {
    /// By coefficients, then by pose unknowns.
    pub gradient: Vec<f64>,
    /// `M0`.
    pub hessian: SystemMatrix,
    /// `U`: pose unknowns x 3, or without columns where nothing is left undetermined.
    pub gauge: Mat<f64>,
}

impl System {
    pub fn zeros(pattern: Arc<Pattern>, gauge: Mat<f64>) -> Self {
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
        gauge::add_pull(&self.gauge, &x[first..], &mut y[first..]);
        y
    }
}

/// A factorisation of a [`System`]'s Hessian, beside the Cholesky factor of `Mp`.
#[derive(Debug, Clone)]
pub struct Factor {
    /// `W` and `V`: unknowns x 6; without columns where there is no gauge.
    pub(crate) modes: Mat<f64>,
    pub(crate) images: Mat<f64>,
    /// `S^-1`.
    pub(crate) inner: SMatrix<f64, MODES, MODES>,
}

impl Factor {
    /// Factorises; `cholesky` then holds the factor of `Mp`, on the system's pattern. An indefinite matrix is an error.
    pub fn factorise(system: &System, cholesky: &mut Cholesky) -> Result<Self, SparseError> {
        let pattern = system.hessian.pattern();
        if !Arc::ptr_eq(cholesky.pattern(), pattern) {
            *cholesky = Cholesky::analyse(pattern)?;
        }
        if system.gauge.ncols() == 0 {
            cholesky.factorise(&system.hessian)?;
            let none = || Mat::zeros(pattern.dimension(), 0);
            return Ok(Self { modes: none(), images: none(), inner: SMatrix::zeros() });
        }
        let held = pinned(pattern);
        let mut matrix = system.hessian.clone();
        matrix.add_pose(held, &(Matrix3::identity() * PIN));
        cholesky.factorise(&matrix)?;
        let (first, n) = (pattern.coefficients(), pattern.dimension());
        let modes = Mat::from_fn(n, MODES, |row, mode| match (row.checked_sub(first), mode) {
            (Some(pose), 0..3) => f64::from(pose == 3 * held + mode),
            (Some(pose), _) => system.gauge[(pose, mode - 3)],
            (None, _) => 0.0,
        });
        let mut images = modes.clone();
        cholesky.solve_block(images.as_mut())?;
        let overlap = modes.transpose() * &images;
        let inner = SMatrix::<f64, MODES, MODES>::from_fn(|a, b| {
            let stiffness = if a < 3 { -PIN } else { 2.0 * gauge::STIFFNESS };
            0.5 * (overlap[(a, b)] + overlap[(b, a)]) + if a == b { 1.0 / stiffness } else { 0.0 }
        });
        let negative = inner.symmetric_eigenvalues().iter().filter(|value| **value < 0.0).count();
        match inner.try_inverse().filter(|_| negative == 3) {
            Some(inner) => Ok(Self { modes, images, inner }),
            None => Err(SparseError::NotPositiveDefinite),
        }
    }

    /// Solves `M x = b` in place; unchecked.
    pub fn solve(&self, cholesky: &mut Cholesky, rhs: &mut [f64]) {
        cholesky.solve(rhs);
        if self.modes.ncols() == 0 {
            return;
        }
        let along = nalgebra::SVector::<f64, MODES>::from_fn(|mode, _| {
            rhs.iter().enumerate().map(|(row, x)| self.modes[(row, mode)] * x).sum()
        });
        let share = self.inner * along;
        for (row, x) in rhs.iter_mut().enumerate() {
            *x -= (0..MODES).map(|mode| self.images[(row, mode)] * share[mode]).sum::<f64>();
        }
    }

    /// Solves `M X = B` in place for a block of right-hand sides; unchecked.
    pub fn solve_block(&self, cholesky: &Cholesky, mut rhs: MatMut<'_, f64>) -> Result<(), SparseError> {
        use faer::reborrow::ReborrowMut;
        cholesky.solve_block(rhs.rb_mut())?;
        if self.modes.ncols() > 0 {
            let inner = Mat::from_fn(MODES, MODES, |a, b| self.inner[(a, b)]);
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

    /// `R = M^-1 (2 + 2 kappa) U`: how all unknowns answer a common motion of the reported poses; without columns where
    /// there is no gauge.
    pub fn answer_to_common_motion(&self) -> Option<Mat<f64>> {
        let n = self.modes.nrows();
        if self.modes.ncols() == 0 {
            return Some(Mat::zeros(n, 0));
        }
        // V0 = M0^-1 U, with the pin taken back.
        let overlap = |a: usize, b: usize| -> Matrix3<f64> {
            let part = self.modes.subcols(a, 3).transpose() * self.images.subcols(b, 3);
            Matrix3::from_fn(|row, column| part[(row, column)])
        };
        let unpin = (Matrix3::identity() / PIN - overlap(0, 0)).try_inverse()? * overlap(0, 3);
        let unpin = Mat::from_fn(3, 3, |a, b| unpin[(a, b)]);
        let free = self.images.subcols(3, 3) + self.images.subcols(0, 3) * unpin;
        let own = self.modes.subcols(3, 3).transpose() * &free;
        let own = Matrix3::from_fn(|a, b| own[(a, b)]);
        let stiff = 2.0 * gauge::STIFFNESS;
        let share = (Matrix3::identity() + own * stiff).try_inverse()? * (2.0 + stiff);
        Some(free * Mat::from_fn(3, 3, |a, b| share[(a, b)]))
    }
}

/// The pose that sees most.
fn pinned(pattern: &Pattern) -> usize {
    let views = pattern.views();
    (0..views.poses()).max_by_key(|&pose| (views.view(pose).len(), std::cmp::Reverse(pose))).unwrap_or(0)
}
