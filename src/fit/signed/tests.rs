//! The objective's derivatives against differences, and the fit's promises on experiment 1.

use std::ops::ControlFlow;

use super::*;
use crate::fit::fit as fit_any;
use crate::scan::{LaserScan, Noise};
use crate::sim::Scenario;
use crate::spline::Lattice;
use rand::{RngExt, SeedableRng};

/// An objective a few steps into its fit, and where it stands.
struct Stand {
    objective: Objective,
    unknowns: Vec<f64>,
}

fn fitted(weighting: Weighting, seed: u64) -> Stand {
    let scenario = Scenario::experiment_one();
    let lattice = Lattice::covering(&scenario.bounds, 0.4, 100_000).unwrap();
    let options = FitOptions { weighting, max_iterations: 3, ..Default::default() };
    let scans = scenario.scans(seed);
    let job = Job::alone(&scans, &scenario.noise, &lattice, &options);
    let estimate = fit(&job, &mut |_| ControlFlow::Continue(())).unwrap();
    let mut unknowns = estimate.surfaces[0].coefficients.clone();
    unknowns.extend(&estimate.resume);
    let weights = Weights::resolve(&options, lattice.resolution, 175.0);
    let viewpoints = viewpoints(&scans, &scenario.noise, weights.model_sigma).unwrap();
    let returns = returns_inside(&scans, &lattice).unwrap();
    let weighing = match weighting {
        Weighting::Paper => Weighing::Frozen(vec![1.5; returns.len()]),
        Weighting::Calibrated => Weighing::Sampson,
    };
    let sightings = Sightings::new(&lattice, returns, viewpoints, weighing);
    let loss = eikonal_loss(&weights, weighting, lattice.resolution);
    let mut objective =
        Objective::new(lattice.clone(), Stencil::of(&lattice), sightings, loss, weights.smoothing, None, 3);
    objective.reweigh(loss, weights.smoothing, weights.poses == Poses::Refined);
    Stand { objective, unknowns }
}

fn fit_room(
    scans: &[LaserScan],
    noise: &Noise,
    lattice: &Lattice,
    observer: Observer<'_>,
) -> Result<Estimate, FitError> {
    fit_any(scans, noise, Distance::Signed, lattice, &FitOptions::default(), &crate::sparse::Team::default(), observer)
}

/// Central differences of value and gradient along random directions, against the assembled system.
fn check_derivatives(weighting: Weighting) {
    let fit = fitted(weighting, 3);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let mut system = fit.objective.system(fit.unknowns.split_at(fit.objective.lattice.len()).1);
    let at = fit.unknowns.clone();
    fit.objective.assemble(&at, Curvature::EXACT, &mut system);
    let (mut ahead, mut behind) = (
        fit.objective.system(fit.unknowns.split_at(fit.objective.lattice.len()).1),
        fit.objective.system(fit.unknowns.split_at(fit.objective.lattice.len()).1),
    );
    for _ in 0..8 {
        let direction: Vec<f64> = at.iter().map(|_| rng.random_range(-1.0..1.0)).collect();
        let e = 1e-6;
        let moved = |t: f64| at.iter().zip(&direction).map(|(x, d)| x + t * d).collect::<Vec<_>>();
        let value_ahead = fit.objective.assemble(&moved(e), Curvature::EXACT, &mut ahead);
        let value_behind = fit.objective.assemble(&moved(-e), Curvature::EXACT, &mut behind);
        assert!((value_ahead - fit.objective.value(&moved(e))).abs() < 1e-9 * value_ahead);
        let slope: f64 = system.gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
        let difference = (value_ahead - value_behind) / (2.0 * e);
        let steepest = system.gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
        assert!((slope - difference).abs() < 1e-6 * steepest, "slope {slope}, difference {difference}");
        let product = system.times(&direction);
        let norm = product.iter().map(|v| v * v).sum::<f64>().sqrt();
        let error = ahead.gradient.iter().zip(&behind.gradient).zip(&product);
        let error = error.map(|((a, b), p)| ((a - b) / (2.0 * e) - p).powi(2)).sum::<f64>().sqrt();
        assert!(error < 1e-6 * norm, "Hessian product off by {} relative", error / norm);
    }
}

#[test]
fn derivatives_of_the_published_objective_agree_with_central_differences() {
    check_derivatives(Weighting::Paper);
}

#[test]
fn derivatives_of_the_calibrated_objective_with_poses_agree_with_central_differences() {
    check_derivatives(Weighting::Calibrated);
}

#[test]
fn the_convex_stand_in_has_the_same_gradient_and_no_negative_eigenvalue_and_can_be_mixed_in() {
    let fit = fitted(Weighting::Calibrated, 5);
    let (mut exact, mut convex) = (
        fit.objective.system(fit.unknowns.split_at(fit.objective.lattice.len()).1),
        fit.objective.system(fit.unknowns.split_at(fit.objective.lattice.len()).1),
    );
    let value = fit.objective.assemble(&fit.unknowns, Curvature::EXACT, &mut exact);
    assert_eq!(value, fit.objective.assemble(&fit.unknowns, Curvature::CONVEX, &mut convex));
    assert_eq!(exact.gradient, convex.gradient);
    let mut between = fit.objective.system(fit.unknowns.split_at(fit.objective.lattice.len()).1);
    fit.objective.assemble(&fit.unknowns, Curvature::without_concavity(0.3), &mut between);
    let parts = exact.hessian.values().iter().zip(convex.hessian.values()).zip(between.hessian.values());
    for ((exact, convex), between) in parts {
        assert!((0.7 * exact + 0.3 * convex - between).abs() <= 1e-9 * (exact.abs() + convex.abs()) + 1e-9);
    }
    for pose in 0..3 {
        let (exact, convex) = (exact.hessian.pose(pose), convex.hessian.pose(pose));
        assert!((exact - convex).amax() > 1e-9 * exact.amax(), "the stand-in is not the Hessian");
    }
    convex.hessian.shift_diagonal(|_, _| 1e-9);
    let mut cholesky = Cholesky::analyse(convex.hessian.pattern()).unwrap();
    assert!(Factor::factorise(&convex, &mut cholesky).is_ok());
}

#[test]
fn an_observer_can_cancel_within_one_step() {
    let scenario = Scenario::experiment_one();
    let lattice = Lattice::covering(&scenario.bounds, 0.4, 100_000).unwrap();
    let mut seen = 0;
    let mut stop = |progress: &Progress| {
        seen = progress.iteration;
        if progress.iteration == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let outcome = fit_room(&scenario.scans(0), &scenario.noise, &lattice, &mut stop);
    assert!(matches!(outcome, Err(FitError::Cancelled)));
    assert_eq!(seen, 2);
}

#[test]
fn a_map_without_returns_is_refused() {
    let scenario = Scenario::experiment_one();
    let far = crate::geometry::Bounds { min: [100.0, 100.0], max: [102.0, 102.0] };
    let lattice = Lattice::covering(&far, 0.5, 100_000).unwrap();
    let outcome = fit_room(&scenario.scans(0), &scenario.noise, &lattice, &mut |_| ControlFlow::Continue(()));
    assert!(matches!(outcome, Err(FitError::NoEvidence)));
}

#[test]
fn steps_are_counted_through_all_stages_against_one_limit() {
    let scenario = Scenario::experiment_one();
    let lattice = Lattice::covering(&scenario.bounds, 0.4, 100_000).unwrap();
    let mut seen = Vec::new();
    let mut watch = |progress: &Progress| {
        seen.push((progress.iteration, progress.max_iterations));
        ControlFlow::Continue(())
    };
    let fit = fit_room(&scenario.scans(0), &scenario.noise, &lattice, &mut watch).unwrap();
    assert!(seen.is_sorted() && seen.iter().all(|&(_, limit)| limit == 100));
    assert_eq!(seen.last().unwrap().0, fit.minimum.iterations);
}
