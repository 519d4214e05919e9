//! The covariances' entries between control points that share a cell: all that any query needs.
//!
//! With `H` the lattice's Hessian, `G = sum over returns sigma_r^2 f_cr f_cr^T` on its stencil, and the border `K`,
//! `P`, `S`, `W = H^-1 K` of [`Bordered`]:
//!
//! ```text
//! fixed poses     posterior   2 H^-1
//!                 propagated  H^-1 G H^-1 + F F^T                 F = H^-1 f_cq R, three columns a scan
//! refined poses   posterior   2 (H^-1 + W S^-1 W^T) + W U U^T W^T
//!                 propagated  H^-1 G H^-1 - Y W^T - W Y^T + W Q W^T
//!                   Y = H^-1 (B_c B_e^T - G W) S^-1
//!                   Q = S^-1 (B_e B_e^T - W^T B_c B_e^T - (...)^T + W^T G W) S^-1 + (S^-1 D)(S^-1 D)^T,  D = 2 I + 2 kappa U U^T
//! ```
//!
//! `U` is the gauge ([`gauge`]), which `S` contains. `H^-1` and `H^-1 G H^-1` come from selected inversion; the rest
//! are a few dense columns a scan. `R Q R^T` is the refined poses' propagated covariance. Everything is scaled to be
//! symmetric before it is stored.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::Matrix3;

use super::inputs::{for_each_misfit, for_each_return};
use super::{Kind, UncertaintyError};
use crate::fit::{Bordered, Curvature, Fit, Poses, gauge};
use crate::geometry::Cov3;
use crate::sparse::{CellBlock, StencilMatrix, selected_sandwich};

/// Pose columns are solved for in blocks of this many scans, which bounds memory where there are thousands.
pub(super) const SCANS_A_BLOCK: usize = 64;

/// Covariance entries on the stencil, square metres.
#[derive(Debug, Clone)]
pub struct Marginals {
    pub propagated: StencilMatrix,
    pub posterior: StencilMatrix,
}

impl Marginals {
    pub fn of(&self, kind: Kind) -> &StencilMatrix {
        match kind {
            Kind::Propagated => &self.propagated,
            Kind::Posterior => &self.posterior,
        }
    }
}

/// The covariances of the refined poses in (x, y, theta), a scan each; empty where poses were fixed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PoseCovariance {
    pub propagated: Vec<Cov3>,
    pub posterior: Vec<Cov3>,
}

/// Computes the marginals of a fit. Where the fit's Hessian is indefinite (it did not converge) the convex stand-in
/// takes its place; the fit's `positive_definite` says so.
pub fn marginals(fit: &mut Fit) -> Result<(Marginals, PoseCovariance), UncertaintyError> {
    let border = settle(fit)?;
    let mut g = StencilMatrix::zeros(fit.cholesky.stencil().clone());
    for_each_return(fit, |range, _| {
        let b = &range.by_control_points;
        g.add_cell(range.support[0], &CellBlock::symmetric_product(b, b));
    });
    for_each_misfit(fit, |support, score| g.add_cell(support[0], &CellBlock::symmetric_product(score, score)));
    let (inverse, sandwich) = selected_sandwich(&fit.cholesky, &g)?;
    let mut marginals = Marginals { propagated: sandwich, posterior: inverse };
    let poses = match fit.weights.poses {
        Poses::Fixed => {
            add_fixed_poses(fit, &mut marginals.propagated)?;
            PoseCovariance::default()
        }
        Poses::Refined => add_refined_poses(fit, &border, &g, &mut marginals)?,
    };
    marginals.posterior.values.iter_mut().for_each(|v| *v *= 2.0);
    Ok((marginals, poses))
}

/// Makes sure the fit's system is positive definite and factorised.
pub(super) fn settle(fit: &mut Fit) -> Result<Bordered, UncertaintyError> {
    match Bordered::factorise(&fit.system, &mut fit.cholesky) {
        Ok(border) => Ok(border),
        Err(_) => {
            fit.objective.assemble(&fit.unknowns, Curvature::CONVEX, &mut fit.system);
            let scale = fit.system.hessian.diagonal().iter().sum::<f64>() / fit.cholesky.dimension() as f64;
            fit.system.hessian.shift_diagonal(|_| 1e-9 * scale);
            Ok(Bordered::factorise(&fit.system, &mut fit.cholesky)?)
        }
    }
}

fn add_fixed_poses(fit: &Fit, propagated: &mut StencilMatrix) -> Result<(), UncertaintyError> {
    let (n, scans) = (fit.cholesky.dimension(), fit.poses.len());
    for first in (0..scans).step_by(SCANS_A_BLOCK) {
        let block = first..(first + SCANS_A_BLOCK).min(scans);
        let mut columns = Mat::zeros(n, 3 * block.len());
        for_each_return(fit, |_, pose| {
            if block.contains(&pose.scan) {
                for (k, by_control_points) in pose.by_control_points.iter().enumerate() {
                    for (&row, value) in pose.support.iter().zip(by_control_points) {
                        columns[(row, 3 * (pose.scan - block.start) + k)] += value;
                    }
                }
            }
        });
        fit.cholesky.solve_block(columns.as_mut())?;
        add_products(propagated, columns.as_ref(), columns.as_ref(), 0.5);
    }
    Ok(())
}

fn add_refined_poses(
    fit: &Fit,
    border: &Bordered,
    g: &StencilMatrix,
    marginals: &mut Marginals,
) -> Result<PoseCovariance, UncertaintyError> {
    let (n, poses) = (fit.cholesky.dimension(), border.w.ncols());
    let w = border.w.as_ref();
    let mut shared = Mat::<f64>::zeros(n, poses);
    let mut own = Mat::<f64>::zeros(poses, poses);
    for_each_return(fit, |range, _| {
        for a in 0..3 {
            let column = 3 * range.scan + a;
            for (&row, value) in range.support.iter().zip(&range.by_control_points) {
                shared[(row, column)] += value * range.by_pose[a];
            }
            (0..3).for_each(|b| own[(column, 3 * range.scan + b)] += range.by_pose[a] * range.by_pose[b]);
        }
    });
    let gw = stencil_times(g, w);
    let w_shared = w.transpose() * &shared;
    let middle = &own - &w_shared - w_shared.transpose() + w.transpose() * &gw;
    let s_inverse = border.solve_poses(Mat::identity(poses, poses));
    let reported = pose_image(&s_inverse, &fit.system.gauge);
    let q = &s_inverse * middle * &s_inverse + &reported * reported.transpose();

    let mut y = &shared - &gw;
    fit.cholesky.solve_block(y.as_mut())?;
    let y = y * &s_inverse;
    // -Y W^T - W Y^T + W Q W^T = V W^T + W V^T
    let mut v = y * faer::Scale(-1.0);
    matmul(v.as_mut(), Accum::Add, w, q.as_ref(), 0.5, Par::Seq);
    add_products(&mut marginals.propagated, v.as_ref(), w, 1.0);
    // The gauge's directions have their prior's variance: a half before the doubling at the end.
    let modes = &fit.system.gauge;
    let spread = &s_inverse + (modes * modes.transpose()) * faer::Scale(0.5);
    let t = w * &spread;
    add_products(&mut marginals.posterior, t.as_ref(), w, 0.5);

    let roots = || fit.objective.sightings.viewpoints.iter().map(|viewpoint| viewpoint.root);
    Ok(PoseCovariance {
        propagated: poses_in_world(&q, 1.0, roots()),
        posterior: poses_in_world(&spread, 2.0, roots()),
    })
}

/// Every scan's own block of a covariance in the unknowns `e`, as one in (x, y, theta).
pub(super) fn poses_in_world(matrix: &Mat<f64>, scale: f64, roots: impl Iterator<Item = Cov3>) -> Vec<Cov3> {
    roots
        .enumerate()
        .map(|(scan, root)| {
            let block = Matrix3::from_fn(|a, b| scale * matrix[(3 * scan + a, 3 * scan + b)]);
            root * (block + block.transpose()) * root.transpose() * 0.5
        })
        .collect()
}

/// `S^-1 (2 I + 2 kappa U U^T)`: what a change of the reported poses leaves of itself in the refined ones.
pub(super) fn pose_image(s_inverse: &Mat<f64>, modes: &Mat<f64>) -> Mat<f64> {
    s_inverse * faer::Scale(2.0) + s_inverse * gauge::spring(modes)
}

/// Adds the entries of `scale (A B^T + B A^T)` that are on the stencil.
pub(super) fn add_products(into: &mut StencilMatrix, a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64) {
    let by_rows = |m: MatRef<'_, f64>| -> Vec<f64> {
        (0..m.nrows()).flat_map(|row| (0..m.ncols()).map(move |column| (row, column))).map(|at| m[at]).collect()
    };
    let (width, a, b) = (a.ncols(), by_rows(a), by_rows(b));
    let row = |m: &[f64], k: usize| -> std::ops::Range<usize> {
        debug_assert!((k + 1) * width <= m.len());
        k * width..(k + 1) * width
    };
    let stencil = into.stencil().clone();
    for ((p, q), value) in stencil.entries().zip(&mut into.values) {
        let forward: f64 = a[row(&a, p)].iter().zip(&b[row(&b, q)]).map(|(x, y)| x * y).sum();
        let backward: f64 = a[row(&a, q)].iter().zip(&b[row(&b, p)]).map(|(x, y)| x * y).sum();
        *value += scale * (forward + backward);
    }
}

pub(super) fn stencil_times(matrix: &StencilMatrix, x: MatRef<'_, f64>) -> Mat<f64> {
    let mut y = Mat::zeros(x.nrows(), x.ncols());
    for column in 0..x.ncols() {
        let dense: Vec<f64> = (0..x.nrows()).map(|row| x[(row, column)]).collect();
        for (row, value) in matrix.times(&dense).into_iter().enumerate() {
            y[(row, column)] = value;
        }
    }
    y
}
