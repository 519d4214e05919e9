//! The automatic weights against every point of a grid of hand-set ones, on the same draws.

use std::ops::ControlFlow;

use mapfit::fit::{Distance, FitOptions, fit};
use mapfit::sparse::Team;
use mapfit::spline::Lattice;

use super::cases::Case;
use super::in_parallel;
use super::replicate::Truth;
use super::tally::{median, rms};

pub const HEADER: &str =
    "world,noise,resolution,beams,replicates,weights,eikonal_weight,eikonal_scale,smoothing,boundary_rms,inside_rmse";

/// Around what `docs/calibration.md` settled on, a factor of about three at a time, and two for the scale.
const EIKONAL: [f64; 4] = [300.0, 1000.0, 3000.0, 10000.0];
const SCALE: [f64; 3] = [0.1, 0.2, 0.4];
const SMOOTHING: [f64; 3] = [0.3, 1.0, 3.0];

/// The automatic choice first, then the grid.
pub fn choices(base: &FitOptions) -> Vec<FitOptions> {
    let by_hand = EIKONAL.into_iter().flat_map(|eikonal| {
        SCALE.into_iter().flat_map(move |scale| SMOOTHING.into_iter().map(move |smoothing| (eikonal, scale, smoothing)))
    });
    std::iter::once(*base)
        .chain(by_hand.map(|(eikonal, scale, smoothing)| FitOptions {
            eikonal_weight: Some(eikonal),
            eikonal_scale: Some(scale),
            smoothing: Some(smoothing),
            ..*base
        }))
        .collect()
}

/// A line of the table: medians over the draws of the root mean square errors at the true wall and in seen free space.
pub fn line(case: &Case, truth: &Truth, options: &FitOptions, replicates: u64, threads: usize) -> String {
    let scenario = &case.scenario;
    let drawn = in_parallel(replicates, threads, |seed| {
        let lattice = Lattice::covering(&scenario.bounds, scenario.resolution, 1_000_000).expect("a lattice");
        let scans = scenario.scans(1000 + seed);
        let fitted = fit(&scans, &scenario.noise, Distance::Signed, &lattice, options, &Team::default(), &mut |_| {
            ControlFlow::Continue(())
        })
        .expect("a fit");
        let distance = |p| fitted.surfaces[0].jet(p).map_or(f64::NAN, |jet| jet.value);
        let wall = rms(truth.boundary.iter().map(|&p| distance(p)));
        let inside = rms(truth.inside.iter().map(|&(p, exact)| distance(p) - exact));
        (wall, inside, fitted.weights)
    });
    let weights = &drawn[0].2;
    format!(
        "{},{},{},{},{replicates},{},{:.0},{:.2},{:.2},{:.5},{:.5}",
        case.world,
        case.noise,
        scenario.resolution,
        case.beams,
        if options.eikonal_weight.is_none() { "automatic" } else { "grid" },
        weights.eikonal,
        weights.eikonal_scale.unwrap_or(f64::NAN),
        weights.smoothing,
        median(drawn.iter().map(|d| d.0).collect()),
        median(drawn.iter().map(|d| d.1).collect()),
    )
}
