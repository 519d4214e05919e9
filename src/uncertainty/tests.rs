//! Both covariances against dense references, and against what a changed input does to the minimum.

use std::ops::ControlFlow;

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;

use super::*;
use crate::fit::{
    Fit, FitOptions, Law, Minimum, Newton, Poses, StoppingRule, VectorFit, Weighting, fit, fit_vector, gauge,
};
use crate::scan::LaserScan;
use crate::sim::Scenario;
use crate::sparse::StencilMatrix;
use crate::spline::Lattice;

fn options(poses: Poses) -> FitOptions {
    FitOptions { poses: Some(poses), tolerance: 1e-11, ..Default::default() }
}

fn fitted(scans: &[LaserScan], options: &FitOptions) -> Fit {
    let scenario = Scenario::experiment_one();
    let lattice = Lattice::covering(&scenario.bounds, 0.5, 100_000).unwrap();
    fit(scans, &scenario.noise, &lattice, options, &mut |_| ControlFlow::Continue(())).unwrap()
}

/// `M` and `B` as dense matrices.
fn dense(factors: &Factors) -> (Mat<f64>, Mat<f64>) {
    let h = factors.hessian.to_dense();
    let (n, p) = (factors.coefficients(), factors.coupling.columns());
    let mut m = Mat::zeros(n + p, n + p);
    for k in (0..n).step_by(h.nrows()) {
        m.submatrix_mut(k, k, h.nrows(), h.nrows()).copy_from(&h);
    }
    for column in 0..p {
        for (row, value) in factors.coupling.column(column) {
            m[(row, n + column)] = value;
            m[(n + column, row)] = value;
        }
        for a in 0..3 {
            let scan = column / 3;
            m[(n + 3 * scan + a, n + column)] = factors.poses[scan][(a, column % 3)];
        }
    }
    let spring = gauge::spring(&factors.gauge);
    (0..spring.nrows()).for_each(|a| (0..spring.ncols()).for_each(|b| m[(n + a, n + b)] += spring[(a, b)]));
    let mut b = Mat::zeros(n + p, factors.inputs.columns());
    for column in 0..b.ncols() {
        factors.inputs.column(column).for_each(|(row, value)| b[(row, column)] = value);
    }
    (m, b)
}

/// The propagated and the posterior covariance of all coefficients.
fn exact_covariances(factors: &Factors) -> [Mat<f64>; 2] {
    let (m, b) = dense(factors);
    let inverse = m.partial_piv_lu().inverse();
    let image = &inverse * &b;
    let mut posterior = &inverse * faer::Scale(2.0);
    let n = factors.coefficients();
    if factors.gauge.ncols() > 0 {
        // The map's answer to a common motion of all poses, whose variance along the gauge is one.
        let h = m.submatrix(0, 0, n, n).to_owned().partial_piv_lu().inverse();
        let moved = h * m.submatrix(0, n, n, m.ncols() - n) * &factors.gauge;
        let mut own = posterior.submatrix_mut(0, 0, n, n);
        own += &moved * moved.transpose();
    }
    [&image * image.transpose(), posterior]
}

/// How far entries may be from dense inverses, as a share of the standard deviations: of a signed map, and of a vector
/// field, whose loosely held fringe rounds worse.
const SIGNED: f64 = 1e-9;
const VECTOR: f64 = 1e-8;

/// The stored entries, of rows from `first.0` and columns from `first.1` on, against the exact ones.
fn check_entries(stored: &StencilMatrix, exact: &Mat<f64>, first: (usize, usize), within: f64) {
    for ((p, q), value) in stored.stencil().entries().zip(&stored.values) {
        let (p, q) = (first.0 + p, first.1 + q);
        let scale = (exact[(p, p)] * exact[(q, q)]).sqrt();
        assert!((value - exact[(p, q)]).abs() <= within * scale, "({p}, {q}): {value} for {}", exact[(p, q)]);
    }
}

/// A block from the factors, of the first component and the last.
fn check_block(factors: &Factors, kind: Kind, exact: &Mat<f64>, within: f64) {
    let last = factors.coefficients() - 160;
    let window: Vec<usize> = (100..120).chain(last..last + 20).collect();
    let block = factors.block(kind, &window).unwrap();
    for (row, &p) in window.iter().enumerate() {
        for (column, &q) in window.iter().enumerate() {
            let scale = (exact[(p, p)] * exact[(q, q)]).sqrt();
            assert!((block[row * 40 + column] - exact[(p, q)]).abs() <= within * scale);
        }
    }
}

fn vector_fitted(poses: Poses) -> VectorFit {
    let scenario = Scenario::experiment_one();
    let lattice = Lattice::covering(&scenario.bounds, 0.5, 100_000).unwrap();
    let options = FitOptions { poses: Some(poses), ..Default::default() };
    fit_vector(&scenario.scans(4), &scenario.noise, &lattice, &options, &mut |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn both_components_of_a_vector_field_agree_with_a_dense_reference() {
    for poses in [Poses::Fixed, Poses::Refined] {
        let mut fit = vector_fitted(poses);
        assert!(fit.converged);
        let (marginals, _) = vector_marginals(&mut fit).unwrap();
        let factors = Factors::of_vector(&fit);
        let n = fit.field[0].lattice.len();
        for (kind, exact) in [Kind::Propagated, Kind::Posterior].into_iter().zip(&exact_covariances(&factors)) {
            for (part, first) in marginals.of(kind).parts().into_iter().zip([(0, 0), (0, n), (n, 0), (n, n)]) {
                check_entries(part, exact, first, VECTOR);
            }
            check_block(&factors, kind, exact, VECTOR);
        }
        check_elimination(&factors);
    }
}

fn check_against_dense(options: FitOptions) {
    let mut fit = fitted(&Scenario::experiment_one().scans(4), &options);
    assert!(fit.converged);
    let (marginals, poses) = marginals(&mut fit).unwrap();
    let factors = Factors::of(&mut fit).unwrap();
    let (m, b) = dense(&factors);
    let image = m.partial_piv_lu().inverse() * &b;
    let n = fit.surface.lattice.len();
    let [propagated, posterior] = exact_covariances(&factors);
    for (kind, exact) in [(Kind::Propagated, &propagated), (Kind::Posterior, &posterior)] {
        check_entries(marginals.of(kind), exact, (0, 0), SIGNED);
        check_block(&factors, kind, exact, SIGNED);
    }
    for (scan, covariance) in poses.propagated.iter().enumerate() {
        let root = fit.objective.sightings.viewpoints[scan].root;
        // The pose is q0 + R e: its error is that of the report plus that of e, which answer each other.
        let reported = b.ncols() - 3 * poses.propagated.len() + 3 * scan;
        let mut error = nalgebra::Matrix3::zeros();
        for input in 0..b.ncols() {
            let direct = |a: usize| f64::from(input == reported + a);
            let change = nalgebra::Vector3::from_fn(|a, _| direct(a) - image[(n + 3 * scan + a, input)]);
            error += change * change.transpose();
        }
        assert!((root * error * root.transpose() - covariance).norm() < 1e-9 * covariance.norm());
    }
}

#[test]
fn fixed_poses_agree_with_a_dense_reference() {
    check_against_dense(options(Poses::Fixed));
}

#[test]
fn refined_poses_agree_with_a_dense_reference() {
    check_against_dense(options(Poses::Refined));
}

#[test]
fn the_published_objective_agrees_with_a_dense_reference() {
    check_against_dense(FitOptions { weighting: Weighting::Paper, tolerance: 1e-10, ..Default::default() });
}

/// The common motion free, poses fixed, and one pose exactly known, which ties the frame down.
#[test]
fn eliminating_the_poses_leaves_both_covariances_as_they_are() {
    let scans = Scenario::experiment_one().scans(2);
    let mut known = scans.clone();
    known[0].pose_covariance = Some(crate::geometry::Cov3::zeros());
    for (scans, poses) in [(&scans, Poses::Refined), (&scans, Poses::Fixed), (&known, Poses::Refined)] {
        check_elimination(&Factors::of(&mut fitted(scans, &options(poses))).unwrap());
    }
}

fn check_elimination(factors: &Factors) {
    let reduced = factors.reduced(usize::MAX).unwrap();
    let full = |columns: &CompressedColumns| {
        let mut matrix = Mat::<f64>::zeros(columns.rows, columns.columns());
        for column in 0..columns.columns() {
            columns.column(column).for_each(|(row, value)| matrix[(row, column)] = value);
        }
        matrix
    };
    let inverse = full(&reduced.hessian).partial_piv_lu().inverse();
    let image = &inverse * full(&reduced.inputs);
    let points: Vec<usize> = (200..230).collect();
    let (propagated, posterior) =
        (factors.block(Kind::Propagated, &points).unwrap(), factors.block(Kind::Posterior, &points).unwrap());
    for (row, &p) in points.iter().enumerate() {
        for (column, &q) in points.iter().enumerate() {
            let exact: f64 = (0..image.ncols()).map(|k| image[(p, k)] * image[(q, k)]).sum();
            // Control points that are not in use have a propagated variance of exactly zero.
            assert!((propagated[row * 30 + column] - exact).abs() <= 1e-9 * propagated[row * 31].abs());
            let exact = 2.0 * inverse[(p, q)];
            assert!((posterior[row * 30 + column] - exact).abs() < 1e-8 * posterior[row * 31].abs());
        }
    }
    assert!(factors.reduced(1_000).is_none());
}

/// The implicit function theorem against refitting: one range longer, one pose turned.
#[test]
fn a_changed_input_moves_the_minimum_as_predicted() {
    for poses in [Poses::Fixed, Poses::Refined] {
        let scans = Scenario::experiment_one().scans(6);
        let mut base = fitted(&scans, &options(poses));
        let factors = Factors::of(&mut base).unwrap();
        let (m, b) = dense(&factors);
        let image = m.partial_piv_lu().inverse() * &b;
        let e = 5e-4;
        let beam = base.objective.sightings.returns.iter().position(|seen| seen.scan == 1 && seen.beam == 77).unwrap();
        let c_e = base.unknowns[base.surface.lattice.len()..].to_vec();
        let order: Vec<usize> =
            base.objective.sightings.at(&base.surface.lattice, &c_e).iter().map(|s| s.source).collect();
        let range_column = order.iter().position(|&source| source == beam).unwrap();
        let mut longer = scans.clone();
        longer[1].ranges[77] += e;
        compare(&base, &refitted(&scans, &longer, &options(poses)), &image, range_column, e / 0.02);
        let mut turned = scans.clone();
        turned[2].pose.theta += e;
        // Roots of diagonal covariances are diagonal up to order: find theta's column by its only entry.
        let root = base.objective.sightings.viewpoints[2].root;
        let axis = (0..3).max_by(|&a, &b| root[(2, a)].abs().total_cmp(&root[(2, b)].abs())).unwrap();
        let column = image.ncols() - 9 + 6 + axis;
        compare(&base, &refitted(&scans, &turned, &options(poses)), &image, column, e / root[(2, axis)]);
    }
}

/// The minimum near that of `scans` where the returns are those of `changed`. Everything else stays: which cells hold
/// evidence, and which of several minima is meant, are no smooth functions of the input.
fn refitted(scans: &[LaserScan], changed: &[LaserScan], options: &FitOptions) -> Vec<f64> {
    let mut fit = fitted(scans, options);
    fit.objective.sightings = fitted(changed, options).objective.sightings;
    let rule = StoppingRule {
        max_iterations: 50,
        tolerance: 1e-9,
        first_gradient: None,
        certify: true,
        chords: 0,
        law: Law::Concavity,
    };
    let mut unknowns = fit.unknowns;
    Newton::new(&fit.objective, &mut fit.cholesky, Minimum::default())
        .minimise(&mut unknowns, &rule, &mut |_| ControlFlow::Continue(()))
        .unwrap();
    unknowns
}

fn compare(base: &Fit, changed: &[f64], image: &Mat<f64>, column: usize, amount: f64) {
    let n = base.surface.lattice.len();
    let (mut error, mut norm) = (0.0, 0.0);
    for k in 0..n {
        let predicted = -image[(k, column)] * amount;
        error += (changed[k] - base.unknowns[k] - predicted).powi(2);
        norm += predicted * predicted;
    }
    assert!(error.sqrt() < 0.05 * norm.sqrt(), "off by {} of the change", (error / norm).sqrt());
}
