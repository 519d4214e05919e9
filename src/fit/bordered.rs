//! The Newton system: a stencil matrix, bordered by the pose unknowns.
//!
//! ```text
//! [ H    K ] [ c ]   [ b_c ]        W = H^-1 K,  S = P - K^T W  (dense, 3 a scan)
//! [ K^T  P ] [ e ] = [ b_e ]        e = S^-1 (b_e - W^T b_c),  c = H^-1 b_c - W e
//! ```
//!
//! `H` is sparse on the lattice, `P` has a 3 x 3 block a scan, `K` is three columns a scan. Eliminating the lattice
//! first keeps its sparse factor; eliminating poses first would couple all control points a scan sees. A vector field
//! has two components with one `H`, stacked: `c`, `K` and `W` then have twice the rows, and `H` stands for
//! `diag(H, H)`.

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::{Llt, Solve};
use faer::reborrow::ReborrowMut;
use faer::{Accum, Mat, MatMut, Par, Side};
use nalgebra::Matrix3;

use super::chain::InputJet;
use super::gauge;
use crate::geometry::Cov3;
use crate::sparse::{Cholesky, SparseError, StencilMatrix};
use crate::spline::SUPPORT;

/// Gradient and Hessian of an objective with bordering pose unknowns (none where poses are fixed).
#[derive(Debug, Clone)]
pub struct System {
    /// By coefficients, then by pose unknowns.
    pub gradient: Vec<f64>,
    /// The Hessian of each component.
    pub hessian: StencilMatrix,
    /// `K`: coefficients (of all components) x pose unknowns.
    pub coupling: Mat<f64>,
    /// `P`, block by block, without the gauge's share.
    pub poses: Vec<Matrix3<f64>>,
    /// `U` of [`gauge`]: `P` has `2 kappa U U^T` more.
    pub gauge: Mat<f64>,
}

impl System {
    pub fn clear(&mut self) {
        self.gradient.fill(0.0);
        self.hessian.values.fill(0.0);
        self.coupling.fill(0.0);
        self.poses.fill(Matrix3::zeros());
    }

    /// Adds one sighting's derivatives by its scan's pose unknowns, `q = q0 + R e`.
    pub fn add_pose(&mut self, scan: usize, support: &[usize; SUPPORT], root: &Cov3, inputs: &InputJet) {
        let control_points = self.coupling.nrows();
        let by_pose = inputs.gradient.xyz();
        let by_unknowns = root.transpose() * by_pose;
        for k in 0..3 {
            self.gradient[control_points + 3 * scan + k] += by_unknowns[k];
            let column = self.coupling.as_mut().col_mut(3 * scan + k).try_as_col_major_mut();
            if let Some(column) = column.map(|column| column.as_slice_mut()) {
                for (at, &point) in support.iter().enumerate() {
                    column[point] += (0..3).map(|a| inputs.mixed[a][at] * root[(a, k)]).sum::<f64>();
                }
            }
        }
        self.poses[scan] += root.transpose() * inputs.second.fixed_view::<3, 3>(0, 0) * root;
    }

    /// The Hessian's product with a vector of unknowns.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let (c, e) = x.split_at(self.coupling.nrows());
        let mut y: Vec<f64> =
            c.chunks(self.hessian.stencil().dimension()).flat_map(|own| self.hessian.times(own)).collect();
        let e_column = Mat::from_fn(e.len(), 1, |k, _| e[k]);
        let c_column = Mat::from_fn(c.len(), 1, |k, _| c[k]);
        let shared = &self.coupling * &e_column;
        let mut own = self.coupling.transpose() * &c_column;
        for (scan, block) in self.poses.iter().enumerate() {
            let part = block * nalgebra::Vector3::new(e[3 * scan], e[3 * scan + 1], e[3 * scan + 2]);
            (0..3).for_each(|k| own[(3 * scan + k, 0)] += part[k]);
        }
        y.iter_mut().enumerate().for_each(|(k, y)| *y += shared[(k, 0)]);
        y.extend((0..e.len()).map(|k| own[(k, 0)]));
        gauge::add_pull(&self.gauge, e, &mut y[c.len()..]);
        y
    }
}

/// A factorisation of a [`System`]'s Hessian.
pub struct Bordered {
    /// `W = H^-1 K`.
    pub w: Mat<f64>,
    schur: Option<Llt<f64>>,
}

impl Bordered {
    /// Factorises; `cholesky` then holds the factor of `H`. An indefinite matrix is an error.
    pub fn factorise(system: &System, cholesky: &mut Cholesky) -> Result<Self, SparseError> {
        cholesky.factorise(&system.hessian)?;
        let mut w = system.coupling.clone();
        if w.ncols() == 0 {
            return Ok(Self { w, schur: None });
        }
        solve_components(cholesky, w.as_mut())?;
        let mut schur = pose_block(&system.poses, &system.gauge);
        matmul(schur.as_mut(), Accum::Add, system.coupling.transpose(), w.as_ref(), -1.0, Par::Seq);
        let schur = schur.llt(Side::Lower).map_err(|_| SparseError::NotPositiveDefinite)?;
        Ok(Self { w, schur: Some(schur) })
    }

    /// Solves in place; unchecked.
    pub fn solve(&self, cholesky: &mut Cholesky, rhs: &mut [f64]) {
        let (c, e) = rhs.split_at_mut(self.w.nrows());
        if let Some(schur) = &self.schur {
            let b_c = Mat::from_fn(c.len(), 1, |k, _| c[k]);
            let mut reduced = Mat::from_fn(e.len(), 1, |k, _| e[k]);
            matmul(reduced.as_mut(), Accum::Add, self.w.transpose(), b_c.as_ref(), -1.0, Par::Seq);
            schur.solve_in_place(reduced.as_mut());
            (0..e.len()).for_each(|k| e[k] = reduced[(k, 0)]);
            c.chunks_mut(cholesky.dimension()).for_each(|own| cholesky.solve(own));
            let column = MatMut::from_column_major_slice_mut(c, self.w.nrows(), 1);
            matmul(column, Accum::Add, self.w.as_ref(), reduced.as_ref(), -1.0, Par::Seq);
        } else {
            c.chunks_mut(cholesky.dimension()).for_each(|own| cholesky.solve(own));
        }
    }

    /// Solves `M X = B` in place for a block of right-hand sides; unchecked.
    pub fn solve_block(&self, cholesky: &Cholesky, rhs: MatMut<'_, f64>) -> Result<(), SparseError> {
        let (mut c, mut e) = rhs.split_at_row_mut(self.w.nrows());
        if let Some(schur) = &self.schur {
            matmul(e.as_mut(), Accum::Add, self.w.transpose(), c.as_ref(), -1.0, Par::Seq);
            schur.solve_in_place(e.as_mut());
        }
        solve_components(cholesky, c.as_mut())?;
        matmul(c, Accum::Add, self.w.as_ref(), e.as_ref(), -1.0, Par::Seq);
        Ok(())
    }

    /// `S^-1 B` for a block of pose right-hand sides; `B` itself where no pose is unknown.
    pub fn solve_poses(&self, mut rhs: Mat<f64>) -> Mat<f64> {
        if let Some(schur) = &self.schur {
            schur.solve_in_place(rhs.as_mut());
        }
        rhs
    }

    /// Solves `M x = b` and refuses an answer whose residual is not small.
    pub fn solve_checked(&self, system: &System, cholesky: &mut Cholesky, b: &[f64]) -> Result<Vec<f64>, SparseError> {
        let mut x = b.to_vec();
        self.solve(cholesky, &mut x);
        let largest = |v: &mut dyn Iterator<Item = f64>| {
            v.fold(0.0, |worst: f64, v| if v.is_nan() { f64::INFINITY } else { worst.max(v.abs()) })
        };
        let error = largest(&mut system.times(&x).iter().zip(b).map(|(mx, b)| mx - b));
        let scale = largest(&mut b.iter().copied());
        let residual = if scale > 0.0 { error / scale } else { error };
        if residual <= crate::sparse::LARGEST_RESIDUAL { Ok(x) } else { Err(SparseError::Residual { residual }) }
    }
}

/// `P` whole: the scans' own blocks, and the gauge's share.
pub(crate) fn pose_block(poses: &[Matrix3<f64>], modes: &Mat<f64>) -> Mat<f64> {
    let mut block = gauge::spring(modes);
    for (scan, own) in poses.iter().enumerate() {
        (0..9).for_each(|k| block[(3 * scan + k / 3, 3 * scan + k % 3)] += own[(k / 3, k % 3)]);
    }
    block
}

/// Solves `H X = B` in place for every component of stacked right-hand sides; unchecked.
pub(crate) fn solve_components(cholesky: &Cholesky, mut rhs: MatMut<'_, f64>) -> Result<(), SparseError> {
    let n = cholesky.dimension();
    (0..rhs.nrows() / n).try_for_each(|k| cholesky.solve_block(rhs.rb_mut().subrows_mut(k * n, n)))
}
