//! Both covariances against dense references, and against what a changed input does to the minimum.

use std::ops::ControlFlow;

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;

use super::marginals::ROUNDING;
use super::*;
use crate::fit::{Distance, End, Estimate, FitOptions, Poses, Weighting, fit, resume};
use crate::scan::LaserScan;
use crate::sim::Scenario;
use crate::sparse::Team;
use crate::spline::Lattice;

fn lattice() -> Lattice {
    Lattice::covering(&Scenario::experiment_one().bounds, 0.5, 100_000).unwrap()
}

fn fitted(scans: &[LaserScan], distance: Distance, options: &FitOptions) -> Estimate {
    let noise = Scenario::experiment_one().noise;
    fit(scans, &noise, distance, &lattice(), options, &Team::default(), &mut |_| ControlFlow::Continue(())).unwrap()
}

/// `M` and `B` as dense matrices: all inputs, then the reports, then rounding.
fn dense(estimate: &Estimate) -> (Mat<f64>, Mat<f64>) {
    let pattern = estimate.system.hessian.pattern().clone();
    let (n, unknowns) = (pattern.coefficients(), pattern.dimension());
    let mut m = estimate.system.hessian.to_dense();
    let spring = match estimate.system.gauge.ncols() {
        0 => Mat::zeros(unknowns - n, unknowns - n),
        _ => estimate.system.gauge.spring(),
    };
    (0..unknowns - n).for_each(|a| (0..unknowns - n).for_each(|b| m[(n + a, n + b)] += spring[(a, b)]));
    let (points, row) = (pattern.stencil().dimension(), pattern.stencil().size()[0]);
    let mut columns: Vec<Vec<(usize, f64)>> = Vec::new();
    super::marginals::for_each_carried(estimate, &mut |input| {
        let mut column = Vec::new();
        for (k, own) in input.by_control_points[..pattern.components()].iter().enumerate() {
            column.extend((0..16).map(|at| (k * points + input.first + at % 4 + at / 4 * row, own[at])));
        }
        for (pose, own) in input.by_poses {
            column.extend((0..3).map(|a| (n + 3 * pose + a, own[a])));
        }
        columns.push(column);
    });
    for b in 0..unknowns - n {
        let report = |a: usize| spring[(a, b)] + if a == b { estimate.prior() } else { 0.0 };
        columns.push((0..unknowns - n).map(|a| (n + a, report(a))).collect());
    }
    let diagonal = estimate.system.hessian.diagonal();
    columns.extend((0..n).map(|k| vec![(k, ROUNDING * diagonal[k].sqrt())]));
    let mut b = Mat::zeros(unknowns, columns.len());
    for (k, column) in columns.iter().enumerate() {
        column.iter().for_each(|(row, value)| b[(*row, k)] += value);
    }
    (m, b)
}

/// The inverse, with the unknowns scaled alike: held poses are 1e12 times stiffer than control points.
fn inverse_of(m: &Mat<f64>) -> Mat<f64> {
    let scale: Vec<f64> = (0..m.nrows()).map(|k| m[(k, k)].sqrt()).collect();
    let scaled = Mat::from_fn(m.nrows(), m.ncols(), |a, b| m[(a, b)] / (scale[a] * scale[b]));
    let inverse = scaled.partial_piv_lu().inverse();
    Mat::from_fn(m.nrows(), m.ncols(), |a, b| inverse[(a, b)] / (scale[a] * scale[b]))
}

/// The propagated and the posterior covariance of all unknowns.
fn exact_covariances(estimate: &Estimate) -> [Mat<f64>; 2] {
    let (m, b) = dense(estimate);
    let inverse = inverse_of(&m);
    let image = &inverse * &b;
    let n = estimate.system.hessian.pattern().coefficients();
    let mut posterior = &inverse * faer::Scale(2.0);
    if estimate.system.gauge.held > 0 {
        // The answer to a common motion of all reports, whose variance along the gauge is one.
        let inputs = b.ncols() - n;
        let reports = image.subcols(inputs - (m.nrows() - n), m.nrows() - n);
        let moved = reports * estimate.system.gauge.columns.subcols(0, 3);
        posterior += &moved * moved.transpose();
    }
    [&image * image.transpose(), posterior]
}

/// How far entries may be from dense inverses, as a share of the standard deviations.
const WITHIN: f64 = 1e-8;

fn check_against_dense(distance: Distance, options: &FitOptions) {
    check_scans_against_dense(&Scenario::experiment_one().scans(4), distance, options);
}

fn check_scans_against_dense(scans: &[LaserScan], distance: Distance, options: &FitOptions) {
    let mut estimate = fitted(scans, distance, options);
    assert!(estimate.converged || options.weighting == Weighting::Paper);
    let exact = exact_covariances(&estimate);
    let (marginals, poses) = marginals(&mut estimate, &|_| true).unwrap();
    let factors = Factors::of(&mut estimate).unwrap();
    let pattern = marginals.propagated.pattern().clone();
    let n = pattern.coefficients();
    for (kind, exact) in Kind::ALL.into_iter().zip(&exact) {
        let refined = estimate.weights.poses == Poses::Refined;
        for (p, q, at) in pattern.entries().filter(|(p, q, _)| refined || p.max(q) < &n) {
            let (value, scale) = (marginals.of(kind).values()[at], (exact[(p, p)] * exact[(q, q)]).sqrt());
            assert!((value - exact[(p, q)]).abs() <= WITHIN * scale, "{kind:?} ({p}, {q}): {value} {}", exact[(p, q)]);
        }
    }
    for (scan, covariance) in poses.propagated.iter().enumerate() {
        let root = estimate.viewpoints[scan].root;
        let own = nalgebra::Matrix3::from_fn(|a, b| exact[0][(n + 3 * scan + a, n + 3 * scan + b)]);
        assert!((root * own * root.transpose() - covariance).norm() < 1e-8 * covariance.norm());
    }
    let stencil = pattern.stencil();
    let points: Vec<usize> = (200..230).filter(|point| stencil.is_active(*point)).collect();
    check_export(&factors, &exact[0], &points);
    check_blocks(estimate, n, &exact);
}

/// A block's entries, of coefficients near each other and far apart, in an order that is not that of elimination.
fn check_blocks(estimate: Estimate, n: usize, exact: &[Mat<f64>; 2]) {
    let joint = Joint::of(estimate, &|_| true).unwrap();
    for (kind, exact) in Kind::ALL.into_iter().zip(exact) {
        let window: Vec<usize> = (100..120).chain(n - 160..n - 140).rev().collect();
        // All of them, and as few as a scan has unknowns: other kernels.
        for window in [&window[..], &window[18..21]] {
            let block = joint.block(kind, window, &Team::of_this_machine(), &|| true).unwrap();
            for (k, (&p, &q)) in window.iter().flat_map(|p| window.iter().map(move |q| (p, q))).enumerate() {
                let scale = (exact[(p, p)] * exact[(q, q)]).sqrt();
                assert!((block[k] - exact[(p, q)]).abs() <= WITHIN * scale, "{kind:?} block ({p}, {q})");
            }
        }
        assert!(joint.block(kind, &window, &Team::alone(), &|| false).is_err(), "asked whether to go on");
    }
}

/// What a client makes of the exported factors.
fn check_export(factors: &Factors, exact: &Mat<f64>, points: &[usize]) {
    for limit in [usize::MAX, 0] {
        let ExportedFactors { hessian, inputs } = factors.exported(limit);
        let full = |columns: &CompressedColumns| {
            let mut matrix = Mat::<f64>::zeros(columns.rows, columns.columns());
            (0..columns.columns()).for_each(|k| columns.column(k).for_each(|(row, value)| matrix[(row, k)] = value));
            matrix
        };
        let image = full(&hessian).partial_piv_lu().inverse() * full(&inputs);
        for (&p, &q) in points.iter().flat_map(|p| points.iter().map(move |q| (p, q))) {
            let own: f64 = (0..image.ncols()).map(|k| image[(p, k)] * image[(q, k)]).sum();
            // Rounding's share is no column of theirs.
            let scale = (exact[(p, p)] * exact[(q, q)]).sqrt();
            assert!((own - exact[(p, q)]).abs() <= 1e-6 * scale, "({p}, {q}): {own} for {}", exact[(p, q)]);
        }
    }
}

fn options(poses: Poses) -> FitOptions {
    FitOptions { poses: Some(poses), ..Default::default() }
}

#[test]
fn signed_maps_agree_with_a_dense_reference() {
    for poses in [Poses::Fixed, Poses::Refined] {
        check_against_dense(Distance::Signed, &FitOptions { tolerance: 1e-11, ..options(poses) });
    }
}

#[test]
fn vector_maps_agree_with_a_dense_reference() {
    for poses in [Poses::Fixed, Poses::Refined] {
        check_against_dense(Distance::Vector, &options(poses));
    }
}

#[test]
fn the_published_objectives_agree_with_a_dense_reference() {
    for distance in Distance::ALL {
        let options = FitOptions { weighting: Weighting::Paper, tolerance: 1e-10, ..Default::default() };
        check_against_dense(distance, &options);
    }
}

/// Scans of a few beams each: more poses in a part than it has points, which are eliminated before them.
#[test]
fn a_crowd_of_scans_agrees_with_a_dense_reference() {
    let few_beams = |scan: &LaserScan| {
        let parts = scan.ranges.chunks(3).enumerate().map(|(k, ranges)| LaserScan {
            angle_min: scan.bearing(3 * k),
            ranges: ranges.to_vec(),
            ..scan.clone()
        });
        parts.collect::<Vec<_>>()
    };
    let scans: Vec<LaserScan> = Scenario::experiment_one().scans(4).iter().flat_map(few_beams).collect();
    for distance in Distance::ALL {
        check_scans_against_dense(&scans, distance, &FitOptions { tolerance: 1e-11, ..options(Poses::Refined) });
    }
}

#[test]
fn an_exactly_known_pose_ties_the_frame_down() {
    let mut scans = Scenario::experiment_one().scans(2);
    scans[0].pose_covariance = Some(crate::geometry::Cov3::zeros());
    let mut estimate = fitted(&scans, Distance::Signed, &options(Poses::Refined));
    let exact = exact_covariances(&estimate);
    let (marginals, poses) = marginals(&mut estimate, &|_| true).unwrap();
    assert_eq!(poses.propagated[0], crate::geometry::Cov3::zeros());
    let worst = marginals.propagated.pattern().entries().map(|(p, q, at)| {
        (marginals.propagated.values()[at] - exact[0][(p, q)]).abs() / (exact[0][(p, p)] * exact[0][(q, q)]).sqrt()
    });
    assert!(worst.fold(0.0, f64::max) < WITHIN);
}

#[test]
fn a_fit_is_found_again_where_it_ended() {
    let scans = Scenario::experiment_one().scans(3);
    let noise = Scenario::experiment_one().noise;
    for (distance, poses) in Distance::ALL.into_iter().flat_map(|d| [(d, Poses::Fixed), (d, Poses::Refined)]) {
        let estimate = fitted(&scans, distance, &options(poses));
        let coefficients: Vec<&[f64]> = estimate.surfaces.iter().map(|s| s.coefficients.as_slice()).collect();
        let positive_definite = Some(estimate.minimum.positive_definite);
        let end = End { coefficients: &coefficients, poses: &estimate.resume, positive_definite };
        let again =
            resume(&scans, &noise, distance, &lattice(), &options(poses), &Team::default(), (end, &|| true)).unwrap();
        // A fit's pattern also holds what its poses saw on the way.
        let (again, before) = (again.system.hessian.diagonal(), estimate.system.hessian.diagonal());
        assert!(again.iter().zip(&before).all(|(a, b)| (a - b).abs() <= 1e-9 * b.abs()));
    }
}

#[test]
fn whoever_is_asked_to_stop_stops() {
    let mut estimate = fitted(&Scenario::experiment_one().scans(1), Distance::Vector, &options(Poses::Refined));
    assert!(matches!(marginals(&mut estimate, &|_| false), Err(UncertaintyError::Cancelled)));
}

/// The implicit function theorem against refitting: one range longer, one pose turned.
#[test]
fn a_changed_input_moves_the_minimum_as_predicted() {
    for poses in [Poses::Fixed, Poses::Refined] {
        let options = FitOptions { tolerance: 1e-11, ..options(poses) };
        let scans = Scenario::experiment_one().scans(6);
        let base = fitted(&scans, Distance::Signed, &options);
        let (m, b) = dense(&base);
        let n = base.lattice.len();
        let inverse = inverse_of(&m);
        let e = 2e-5;
        let mut turned = scans.clone();
        turned[2].pose.theta += e;
        let root = base.viewpoints[2].root;
        let axis = (0..3).max_by(|&a, &b| root[(2, a)].abs().total_cmp(&root[(2, b)].abs())).unwrap();
        // A report's column is the prior's, in its own row; a pose moved is its unknowns moved.
        let report = b.ncols() - n - (m.nrows() - n) + 6 + axis;
        let image = &inverse * b.subcols(report, 1);
        let moved = fitted(&turned, Distance::Signed, &options);
        let (mut error, mut norm) = (0.0, 0.0);
        for k in 0..n {
            let predicted = image[(k, 0)] * e / root[(2, axis)];
            error += (moved.surfaces[0].coefficients[k] - base.surfaces[0].coefficients[k] - predicted).powi(2);
            norm += predicted * predicted;
        }
        assert!(error.sqrt() < 0.05 * norm.sqrt(), "{poses:?}: off by {} of the change", (error / norm).sqrt());
    }
}

/// One beam, three, and many in one direction: what is given is right, however little was seen.
#[test]
fn little_evidence_agrees_with_a_dense_reference() {
    let mut scans = Scenario::experiment_one().scans(1);
    scans.truncate(1);
    for beams in [vec![1.0], vec![1.0, f64::NAN, 1.2], vec![0.7; 40]] {
        scans[0].ranges = beams;
        for poses in [Poses::Fixed, Poses::Refined] {
            let mut estimate = fitted(&scans, Distance::Vector, &options(poses));
            let exact = exact_covariances(&estimate);
            let (marginals, _) = marginals(&mut estimate, &|_| true).unwrap();
            for (kind, exact) in Kind::ALL.into_iter().zip(&exact) {
                let own = marginals.of(kind).diagonal();
                let n = estimate.system.hessian.pattern().coefficients();
                assert!((0..n).all(|k| (own[k] / exact[(k, k)] - 1.0).abs() < 1e-6), "{poses:?} {kind:?}");
            }
        }
    }
}

/// Experiment 1's three scans, the second and the third reported in a frame of their own.
#[test]
fn of_joined_maps_entries_and_frames_agree_with_dense_inverses() {
    let mut scans = Scenario::experiment_one().scans(6);
    scans[1..].iter_mut().for_each(|scan| scan.frame = 1);
    for distance in Distance::ALL {
        let mut estimate = fitted(&scans, distance, &FitOptions::default());
        assert!(estimate.converged);
        let exact = exact_covariances(&estimate);
        let (m, b) = dense(&estimate);
        let (marginals, _) = marginals(&mut estimate, &|_| true).unwrap();
        let pattern = marginals.propagated.pattern().clone();
        let n = pattern.coefficients();
        for (kind, exact) in Kind::ALL.into_iter().zip(&exact) {
            for (p, q, at) in pattern.entries() {
                let (value, scale) = (marginals.of(kind).values()[at], (exact[(p, p)] * exact[(q, q)]).sqrt());
                let far = (value - exact[(p, q)]).abs();
                assert!(far <= 1e-6 * scale, "{distance:?} {kind:?} ({p}, {q}): {value} {}", exact[(p, q)]);
            }
        }
        // A frame's error: what the fit makes of all inputs, less the reports' own noise, along the frame's motion.
        let frame = estimate.system.gauge.frames[0].clone();
        let unknowns = m.nrows() - n;
        let told = Mat::from_fn(m.nrows(), 3, |row, k| match row.checked_sub(n) {
            Some(pose) => (0..3)
                .map(|c| estimate.system.gauge.columns[(pose, frame.first + c)] * frame.scale[(k, c)])
                .sum::<f64>(),
            None => 0.0,
        });
        let mut error = told.transpose() * (inverse_of(&m) * &b);
        // The reports' columns are the last before rounding's.
        let first = b.ncols() - n - unknowns;
        for (k, column) in (0..3).flat_map(|k| (0..unknowns).map(move |column| (k, column))) {
            error[(k, first + column)] -= told[(n + column, k)];
        }
        let exact = &error * error.transpose();
        let shifts = frame_shifts(&mut estimate).unwrap();
        let [shift] = &shifts[..] else { panic!("{shifts:?}") };
        for (a, b) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))) {
            let scale = (exact[(a, a)] * exact[(b, b)]).sqrt();
            assert!(
                (shift.covariance[(a, b)] - exact[(a, b)]).abs() < 1e-4 * scale,
                "{distance:?} {shift:?} {exact:?}"
            );
        }
        // Both halves see the room: the frame is known to centimetres.
        assert!(shift.motion.norm() < 0.1 && shift.covariance[(0, 0)].sqrt() < 0.03, "{shift:?}");
    }
}
