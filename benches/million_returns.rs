//! What a million returns add to a Newton step, beside the factorisation of 9,025 control points. It prints both; the
//! assembly is the larger on a lattice this small, and issue 2's closing note says so.

use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use mapfit::fit::{Curvature, FitOptions, Poses, fit};
use mapfit::sim::{Lidar, Scenario};
use mapfit::spline::Lattice;

fn main() {
    let mut scenario = Scenario::experiment_one();
    scenario.lidar = Lidar::of_degrees(3_601, 180.0);
    scenario.poses = scenario.poses.iter().copied().cycle().take(278).collect();
    let lattice = Lattice::covering(&scenario.bounds, 0.1, 100_000).unwrap();
    let options = FitOptions { poses: Some(Poses::Fixed), max_iterations: 1, ..Default::default() };
    let scans = scenario.scans(1);
    let mut fit = fit(&scans, &scenario.noise, &lattice, &options, &mut |_| ControlFlow::Continue(())).unwrap();
    let mut system = fit.objective.system();
    let assembly = median(|| {
        black_box(fit.objective.assemble(&fit.unknowns, Curvature::CONVEX, &mut system));
    });
    let diagonal = system.hessian.diagonal().iter().sum::<f64>() / lattice.len() as f64;
    system.hessian.shift_diagonal(|_| 1e-6 * diagonal);
    let factorisation = median(|| fit.cholesky.factorise(&system.hessian).unwrap());
    let returns = fit.objective.sightings.returns.len();
    println!(
        "{returns} returns on {} control points: assembly {assembly:.1?}, factorisation {factorisation:.1?}",
        lattice.len()
    );
}

fn median(mut work: impl FnMut()) -> Duration {
    let mut times: Vec<Duration> = (0..5)
        .map(|_| {
            let begun = Instant::now();
            work();
            begun.elapsed()
        })
        .collect();
    times.sort();
    times[2]
}
