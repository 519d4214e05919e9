//! What updates cost and how near they come to one fit of all scans, on simulated buildings: the figures of
//! `docs/living-maps.md`. `cargo run --release --example living -- [rooms a side] [new scans]`

use mapfit::fit::Distance;
use mapfit::geometry::Vec2;
use mapfit::map::{FittedMap, Survey};
use mapfit::scan::{LaserScan, Noise};
use mapfit::sim::{self, misplaced};
use mapfit::uncertainty::Kind;

const NOISE: Noise = Noise { sigma_x: 0.05, sigma_y: 0.05, sigma_theta: 0.005, sigma_range: 0.02 };

fn main() {
    let argument = |k: usize, usual: usize| std::env::args().nth(k).and_then(|n| n.parse().ok()).unwrap_or(usual);
    let (side, new) = (argument(1, 8), argument(2, 8));
    let scans = misplaced(&sim::Survey::halls(side, NOISE.sigma_range, 1).scans, &NOISE, 1);
    for distance in [Distance::Vector, Distance::Signed] {
        compare(distance, &scans, new);
    }
}

fn survey(scans: &[LaserScan], distance: Distance) -> Survey<'_> {
    Survey::new(scans, NOISE).distance(distance).resolution(0.2)
}

fn compare(distance: Distance, scans: &[LaserScan], new: usize) {
    let whole = survey(scans, distance).map().unwrap();
    let lattice = whole.lattice().clone();
    let parent = survey(&scans[..scans.len() - new], distance).lattice(lattice.clone()).map().unwrap();
    let update = survey(scans, distance).lattice(lattice).on(&parent.poses).map().unwrap();
    for (name, map) in [("batch", &whole), ("parent", &parent), ("update", &update)] {
        let FittedMap { report, .. } = map;
        println!(
            "{} {name}: {:.2} s ({:.2} fitting, {:.2} covariance), {} steps, {} factorisations, {}",
            distance.name(),
            report.seconds,
            report.stages.fitting,
            report.stages.covariance,
            report.iterations,
            report.factorisations,
            if report.converged { "converged" } else { "not converged" }
        );
    }
    let (mut off, mut wider) = (Vec::new(), Vec::new());
    let bounds = whole.lattice().bounds();
    let (nx, ny) = (((bounds.max[0] - bounds.min[0]) / 0.1) as usize, ((bounds.max[1] - bounds.min[1]) / 0.1) as usize);
    for k in 0..nx * ny {
        let p = Vec2::new(bounds.min[0] + 0.1 * (k % nx) as f64 + 0.05, bounds.min[1] + 0.1 * (k / nx) as f64 + 0.05);
        if whole.observed(p) != Some(true) {
            continue;
        }
        let (Some(a), Some(b)) = (whole.distance(p, Kind::Propagated), update.distance(p, Kind::Propagated)) else {
            continue;
        };
        off.push((a.0 - b.0).abs() / a.1);
        wider.push((b.1 / a.1 - 1.0).abs());
    }
    let at = |values: &mut Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * share) as usize]
    };
    println!(
        "{} update against batch: distance off by {:.1e} sigma in the median, {:.1e} at 99 %, {:.1e} at most; sigma by {:.1e}, {:.1e}",
        distance.name(),
        at(&mut off, 0.5),
        at(&mut off, 0.99),
        at(&mut off, 1.0),
        at(&mut wider, 0.5),
        at(&mut wider, 0.99)
    );
}
