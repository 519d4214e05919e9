//! What one Newton step costs, part by part, on experiment 1's lattice of 2,401 control points.
//!
//! The bar: assembly, factorisation and solve together within 3 times the factorisation alone. `cargo bench` prints it.

use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use mapfit::fit::{
    Curvature, Distance, EikonalLoss, Estimate, Factor, FitOptions, Objective, Sightings, Weighing, fit,
};
use mapfit::map::Survey;
use mapfit::scan::returns_of;
use mapfit::sim::Scenario;
use mapfit::sparse::{Cholesky, Stencil, Team, selected_inverse, selected_sandwich};
use mapfit::spline::Lattice;
use mapfit::uncertainty::Kind;

fn lattice(scenario: &Scenario) -> Lattice {
    Lattice::covering(&scenario.bounds, scenario.resolution, 10_000).unwrap()
}

fn fitted() -> Estimate {
    let scenario = Scenario::experiment_one();
    let (scans, lattice) = (scenario.scans(1), lattice(&scenario));
    let go = &mut |_: &mapfit::fit::Progress| ControlFlow::Continue(());
    fit(&scans, &scenario.noise, Distance::Signed, &lattice, &FitOptions::default(), &Team::default(), go).unwrap()
}

/// The objective of a fit, and where it ended.
fn objective(fit: &Estimate) -> (Objective, Vec<f64>) {
    let scenario = Scenario::experiment_one();
    let lattice = lattice(&scenario);
    let returns = returns_of(&scenario.scans(1)).into_iter().filter(|r| lattice.locate(r.point).is_some()).collect();
    let sightings = Sightings::new(&lattice, returns, fit.viewpoints.clone(), Weighing::Sampson);
    let weight = fit.weights.eikonal * scenario.resolution.powi(2);
    let loss = EikonalLoss { weight, scale: fit.weights.eikonal_scale };
    let stencil = Stencil::of(&lattice);
    let mut objective = Objective::new(lattice, stencil, sightings, loss, fit.weights.smoothing, None, 3);
    objective.reweigh(loss, fit.weights.smoothing, true);
    (objective, fit.surfaces[0].coefficients.iter().chain(&fit.resume).copied().collect())
}

fn step(c: &mut Criterion) {
    let fit = fitted();
    let (objective, unknowns) = objective(&fit);
    let mut system = objective.system(&fit.resume);
    objective.assemble(&unknowns, Curvature::CONVEX, &mut system);
    let mut cholesky = Cholesky::analyse(system.hessian.pattern()).unwrap();
    let hessian = system.hessian.clone();
    let negative: Vec<f64> = system.gradient.iter().map(|g| -g).collect();
    c.bench_function("factorisation", |b| b.iter(|| cholesky.factorise(black_box(&hessian)).unwrap()));
    c.bench_function("assembly", |b| {
        b.iter(|| objective.assemble(black_box(&unknowns), Curvature::CONVEX, &mut system))
    });
    let whole = |cholesky: &mut Cholesky, system: &mut mapfit::fit::System| {
        objective.assemble(&unknowns, Curvature::CONVEX, system);
        let factor = Factor::factorise(system, cholesky).unwrap();
        factor.solve_checked(system, cholesky, &negative).unwrap()
    };
    c.bench_function("newton step (poses refined)", |b| b.iter(|| whole(&mut cholesky, &mut system)));
    // Interleaved, so that a noisy machine slows both alike.
    let (mut alone, mut together) = (Vec::new(), Vec::new());
    for _ in 0..300 {
        let begun = Instant::now();
        cholesky.factorise(&hessian).unwrap();
        alone.push(begun.elapsed());
        let begun = Instant::now();
        black_box(whole(&mut cholesky, &mut system));
        together.push(begun.elapsed());
    }
    let ratio = median(together).as_secs_f64() / median(alone).as_secs_f64();
    println!("one Newton step costs {ratio:.2} factorisations (bar: 3)");
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times[times.len() / 2]
}

fn marginals(c: &mut Criterion) {
    let mut fit = fitted();
    Factor::factorise(&fit.system, &mut fit.cholesky).unwrap();
    let go_on = |_: f64| true;
    let g = fit.system.hessian.clone();
    c.bench_function("selected inverse", |b| b.iter(|| selected_inverse(&fit.cholesky, &go_on).unwrap()));
    c.bench_function("selected inverse and sandwich", |b| {
        b.iter(|| selected_sandwich(&fit.cholesky, &g, &go_on).unwrap())
    });
}

fn query(c: &mut Criterion) {
    let scenario = Scenario::experiment_one();
    let scans = scenario.scans(1);
    let map = Survey::new(&scans, scenario.noise).bounds(scenario.bounds).map().unwrap();
    let points: Vec<_> = (0..100_000)
        .map(|k| mapfit::geometry::Vec2::new(8.0 * f64::from(k % 317) / 317.0, 8.0 * f64::from(k / 317) / 317.0))
        .collect();
    c.bench_function("100,000 distances with sigma", |b| {
        b.iter(|| points.iter().map(|&p| map.distance(p, Kind::Propagated).unwrap().1).sum::<f64>())
    });
}

criterion_group! {
    name = kernels;
    config = Criterion::default().sample_size(30).measurement_time(Duration::from_secs(3));
    targets = step, marginals, query
}
criterion_main!(kernels);
