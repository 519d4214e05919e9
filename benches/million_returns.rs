//! What a million returns add to a Newton step, beside the factorisation of 9,025 control points. It prints both; the
//! assembly is the larger on a lattice this small, and issue 2's closing note says so.

use std::hint::black_box;
use std::time::{Duration, Instant};

use mapfit::fit::{Curvature, EikonalLoss, Objective, Sightings, Viewpoint, Weighing, signed_nearest_return};
use mapfit::geometry::Cov3;
use mapfit::scan::{Evidence, LaserScan, ReturnNoise, returns_of};
use mapfit::sim::{Lidar, Scenario};
use mapfit::sparse::{Cholesky, Pattern, Stencil};
use mapfit::spline::Lattice;

fn main() {
    let mut scenario = Scenario::experiment_one();
    scenario.lidar = Lidar::of_degrees(3_601, 180.0);
    scenario.poses = scenario.poses.iter().copied().cycle().take(278).collect();
    let lattice = Lattice::covering(&scenario.bounds, 0.1, 100_000).unwrap();
    let scans = scenario.scans(1);
    let returns: Vec<_> = returns_of(&scans).into_iter().filter(|r| lattice.locate(r.point).is_some()).collect();
    let evidence = Evidence::gather(&lattice, &scans);
    let stencil = Stencil::of(&lattice);
    let mut cholesky = Cholesky::analyse(&Pattern::of_stencil(&stencil)).unwrap();
    let start = signed_nearest_return(&lattice, &returns, &evidence, 0.0, &mut cholesky).unwrap();
    let noise = ReturnNoise { pose: None, range_variance: 4e-4, model_variance: 2.5e-5 };
    let root = Cov3::from_diagonal(&[0.01, 0.01, 0.005].into());
    let viewpoint = |scan: &LaserScan| Viewpoint { position: scan.pose.position(), root, frame: 0, noise };
    let count = returns.len();
    let viewpoints = scans.iter().map(viewpoint).collect();
    let sightings = Sightings::new(&lattice, returns, viewpoints, Weighing::Sampson);
    let loss = EikonalLoss { weight: 30.0, scale: Some(0.2) };
    let objective = Objective::new(lattice.clone(), stencil, sightings, loss, 1.0, None, 3);
    let mut system = objective.system(&[]);
    let assembly = median(|| {
        black_box(objective.assemble(&start.coefficients, Curvature::CONVEX, &mut system));
    });
    let diagonal = system.hessian.diagonal().iter().sum::<f64>() / lattice.len() as f64;
    system.hessian.shift_diagonal(|_, _| 1e-6 * diagonal);
    let mut cholesky = Cholesky::analyse(system.hessian.pattern()).unwrap();
    let factorisation = median(|| cholesky.factorise(&system.hessian).unwrap());
    let returns = count;
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
