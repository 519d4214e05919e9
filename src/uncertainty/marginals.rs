//! The covariances' entries on the pattern: all that any query needs, and the poses'.
//!
//! With `M = M0 + 2 kappa U U^T`, less what loosens joined frames' motions `L` (`fit::gauge`), and its factor ([`Factor`]),
//! `p` the curvature of the poses' prior, and
//!
//! ```text
//! G = sum over inputs b b^T + p^2 I (poses) + ROUNDING^2 diag M0     on the pattern
//! R = M^-1 (p + 2 kappa) U                                          the answer to a common motion of the reports
//! propagated   M^-1 G M^-1 + R R^T - M^-1 p^2 (U U^T + L L^T) M^-1
//! posterior    2 M^-1 + R R^T
//! ```
//!
//! A pose's report enters the objective through the prior alone, so its column of mixed derivatives is `p` in its own
//! row: no column is dense, and none is solved for. `M0^-1` and `M0^-1 G M0^-1` come from selected inversion of the pinned
//! matrix, the pin and the gauge from six columns (Woodbury). `ROUNDING` stands for how exactly an equation of the
//! minimum is met in f64: with it the middle of the sandwich is `F F^T` with `F` of full rank, so that no variance
//! vanishes where the inputs have no say. Nothing is clamped: what comes out indefinite all the same is refused.

use nalgebra::Matrix3;

use super::modes::Modes;
use super::{Kind, UncertaintyError};
use crate::fit::{Estimate, Factor, Input, Poses};
use crate::geometry::Cov3;
use crate::sparse::{CellBlock, SystemMatrix, selected_sandwich};
use crate::spline::SUPPORT;

/// See the module.
pub(super) const ROUNDING: f64 = 1e-7;
/// The largest condition number, by the diagonally scaled Hessian, whose inverse f64 carries.
const WORST_CONDITION: f64 = 1e12;
/// Steps of the power iteration that estimates it.
const POWER_STEPS: usize = 12;

/// Covariance entries on the pattern, square metres; poses in their whitened unknowns.
#[derive(Debug, Clone)]
pub struct Marginals {
    pub propagated: SystemMatrix,
    pub posterior: SystemMatrix,
}

impl Marginals {
    pub fn of(&self, kind: Kind) -> &SystemMatrix {
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

/// Computes the marginals of an estimate. `go_on` is told which share of the work is done and says whether to go on.
pub fn marginals(
    estimate: &mut Estimate,
    go_on: &dyn Fn(f64) -> bool,
) -> Result<(Marginals, PoseCovariance), UncertaintyError> {
    let factor = Factor::factorise(&estimate.system, &mut estimate.cholesky)?;
    check_condition(estimate, &factor)?;
    let g = input_covariance(estimate);
    if !go_on(0.1) {
        return Err(UncertaintyError::Cancelled);
    }
    let (inverse, sandwich) = selected_sandwich(&estimate.cholesky, &g, &|share| go_on(0.1 + 0.9 * share))?;
    let mut marginals = Marginals { propagated: sandwich, posterior: inverse };
    marginals.posterior.scale(2.0);
    let modes = Modes::of(estimate, &factor, &g)?;
    modes.add_to(Kind::Propagated, &mut marginals.propagated);
    modes.add_to(Kind::Posterior, &mut marginals.posterior);
    check_definite(&marginals)?;
    let poses = match estimate.weights.poses {
        Poses::Fixed => PoseCovariance::default(),
        Poses::Refined => PoseCovariance {
            propagated: poses_in_world(estimate, &marginals.propagated),
            posterior: poses_in_world(estimate, &marginals.posterior),
        },
    };
    Ok((marginals, poses))
}

/// `G`.
pub(super) fn input_covariance(estimate: &Estimate) -> SystemMatrix {
    let hessian = &estimate.system.hessian;
    let n = hessian.pattern().stencil().dimension();
    let mut g = SystemMatrix::zeros(hessian.pattern().clone());
    for_each_carried(estimate, &mut |input| add_square(&mut g, input));
    let squared = Matrix3::identity() * estimate.prior().powi(2);
    (0..estimate.poses.len()).for_each(|pose| g.add_pose(pose, &squared));
    let diagonal = hessian.diagonal();
    g.shift_diagonal(|component, point| ROUNDING.powi(2) * diagonal[component * n + point]);
    g
}

/// Adds `b b^T` of one input.
fn add_square(g: &mut SystemMatrix, input: &Input<'_>) {
    let pattern = g.pattern().clone();
    let rows = &input.by_control_points[..pattern.components()];
    for (a, b) in (0..rows.len()).flat_map(|a| (0..rows.len()).map(move |b| (a, b))) {
        g.add_cell((a, b), input.first, &CellBlock::outer(&rows[a], &rows[b]));
    }
    let row = pattern.stencil().size()[0];
    let support: [usize; SUPPORT] = std::array::from_fn(|k| input.first + k % 4 + k / 4 * row);
    for (k, &(pose, own)) in input.by_poses.iter().enumerate() {
        for (component, by_control_points) in rows.iter().enumerate() {
            g.add_coupling((component, pose), &support, |at| own * by_control_points[at]);
        }
        g.add_pose(pose, &(own * own.transpose()));
        input.by_poses[..k].iter().for_each(|(other, theirs)| g.add_pair((pose, *other), &(own * theirs.transpose())));
    }
}

/// Poses that one input ties at most.
const MOST_TIED: usize = 6;

/// Calls back with every input as the sandwich can carry it. One that moves several poses at once ties them; where the
/// factor holds no entry between two of them, or they are many, so that one cell is a small part of what any of them is
/// known by, its share in the map and in each pose are taken as independent.
pub(super) fn for_each_carried(estimate: &Estimate, each: &mut dyn FnMut(&Input<'_>)) {
    let first_pose = estimate.system.hessian.pattern().coefficients();
    estimate.inputs.for_each(&mut |input| {
        let poses = input.by_poses;
        let mut pairs = poses.iter().enumerate().flat_map(|(k, (a, _))| poses[..k].iter().map(move |(b, _)| (*a, *b)));
        let tied = |(a, b): (usize, usize)| estimate.cholesky.holds(first_pose + 3 * a, first_pose + 3 * b);
        if poses.len() <= MOST_TIED && pairs.all(tied) {
            return each(input);
        }
        each(&Input { by_poses: &[], ..*input });
        let by_control_points = [[0.0; SUPPORT]; 2];
        poses.iter().for_each(|own| each(&Input { by_control_points, by_poses: std::slice::from_ref(own), ..*input }));
    });
}

/// Every pose's own block of a covariance, as one in (x, y, theta).
fn poses_in_world(estimate: &Estimate, covariance: &SystemMatrix) -> Vec<Cov3> {
    let own = |(pose, root): (usize, &Cov3)| root * covariance.pose(pose) * root.transpose();
    estimate.viewpoints.iter().map(|viewpoint| &viewpoint.root).enumerate().map(own).collect()
}

/// Refuses a Hessian whose inverse f64 cannot carry: by power iteration with the factor, diagonally scaled.
fn check_condition(estimate: &mut Estimate, factor: &Factor) -> Result<(), UncertaintyError> {
    let hessian = &estimate.system.hessian;
    let scale: Vec<f64> = hessian.diagonal().iter().map(|d| d.sqrt()).collect();
    // A start that favours no direction: a fixed sequence without period.
    let mut x: Vec<f64> = (0..scale.len()).map(|k| ((k as f64 + 1.0) * 0.618_033_988_749_895).fract() - 0.5).collect();
    let mut largest = 0.0;
    for _ in 0..POWER_STEPS {
        let norm = x.iter().map(|v| v * v).sum::<f64>().sqrt();
        x.iter_mut().zip(&scale).for_each(|(v, s)| *v *= s / norm);
        factor.solve(&mut estimate.cholesky, &mut x);
        x.iter_mut().zip(&scale).for_each(|(v, s)| *v *= s);
        largest = x.iter().map(|v| v * v).sum::<f64>().sqrt();
    }
    // The scaled matrix's largest eigenvalue is at most the most entries of a row: bounded by the pattern, so near one.
    if largest.is_finite() && largest <= WORST_CONDITION {
        return Ok(());
    }
    Err(UncertaintyError::IllConditioned { detail: format!("its Hessian's condition is about {largest:.0e}") })
}

/// Refuses covariances with a variance that is not positive, at a control point in use or of a pose.
fn check_definite(marginals: &Marginals) -> Result<(), UncertaintyError> {
    let pattern = marginals.propagated.pattern();
    let (stencil, n) = (pattern.stencil(), pattern.stencil().dimension());
    for kind in Kind::ALL {
        let diagonal = marginals.of(kind).diagonal();
        let in_use = |k: usize| k >= pattern.coefficients() || stencil.is_active(k % n);
        let variances = || diagonal.iter().enumerate().filter(|(k, _)| in_use(*k)).map(|(_, v)| *v);
        let bad = variances().filter(|v| !(v.is_finite() && *v > 0.0)).count();
        if bad > 0 {
            let least = variances().fold(f64::INFINITY, f64::min);
            let detail = format!(
                "{bad} of {} {kind:?} variances are not positive, the least is {least:.1e}",
                variances().count()
            );
            return Err(UncertaintyError::IllConditioned { detail });
        }
    }
    Ok(())
}
