//! What one Newton step costs, part by part, on experiment 1's lattice of 2,401 control points.
//!
//! The bar: assembly, factorisation and solve together within 3 times the factorisation alone. `cargo bench` prints it.

use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use mapfit::fit::{Bordered, Curvature, Fit, FitOptions, fit};
use mapfit::map::FittedMap;
use mapfit::sim::Scenario;
use mapfit::sparse::{Cholesky, selected_inverse, selected_sandwich};
use mapfit::spline::Lattice;
use mapfit::uncertainty::Kind;

fn fitted() -> Fit {
    let scenario = Scenario::experiment_one();
    let lattice = Lattice::covering(&scenario.bounds, scenario.resolution, 10_000).unwrap();
    fit(&scenario.scans(1), &scenario.noise, &lattice, &FitOptions::default(), &mut |_| ControlFlow::Continue(()))
        .unwrap()
}

fn step(c: &mut Criterion) {
    let fit = fitted();
    let mut system = fit.objective.system();
    let mut cholesky = Cholesky::analyse(fit.system.hessian.stencil()).unwrap();
    let negative: Vec<f64> = fit.system.gradient.iter().map(|g| -g).collect();
    c.bench_function("factorisation", |b| b.iter(|| cholesky.factorise(black_box(&fit.system.hessian)).unwrap()));
    c.bench_function("assembly", |b| {
        b.iter(|| fit.objective.assemble(black_box(&fit.unknowns), Curvature::EXACT, &mut system))
    });
    let whole = |cholesky: &mut Cholesky, system: &mut mapfit::fit::System| {
        fit.objective.assemble(&fit.unknowns, Curvature::EXACT, system);
        let border = Bordered::factorise(system, cholesky).unwrap();
        border.solve_checked(system, cholesky, &negative).unwrap()
    };
    c.bench_function("newton step (poses refined)", |b| b.iter(|| whole(&mut cholesky, &mut system)));
    // Interleaved, so that a noisy machine slows both alike.
    let (mut alone, mut together) = (Vec::new(), Vec::new());
    for _ in 0..300 {
        let begun = Instant::now();
        cholesky.factorise(&fit.system.hessian).unwrap();
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
    Bordered::factorise(&fit.system, &mut fit.cholesky).unwrap();
    let g = fit.system.hessian.clone();
    c.bench_function("selected inverse", |b| b.iter(|| selected_inverse(&fit.cholesky).unwrap()));
    c.bench_function("selected inverse and sandwich", |b| b.iter(|| selected_sandwich(&fit.cholesky, &g).unwrap()));
}

fn query(c: &mut Criterion) {
    let scenario = Scenario::experiment_one();
    let (map, _) = FittedMap::finish(fitted(), scenario.noise, || 0.0).unwrap();
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
