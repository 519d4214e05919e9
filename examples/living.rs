//! What updates cost and how near they come to one fit of all scans, and how well joined frames are known, on simulated
//! buildings: the figures of `docs/living-maps.md`. `cargo run --release --example living -- [rooms a side] [new scans] [joins]`

use mapfit::fit::Distance;
use mapfit::geometry::{Cov3, Pose, Vec2};
use mapfit::living::{Guess, aligned, inverse, moved};
use mapfit::map::{FittedMap, Survey};
use mapfit::scan::{LaserScan, Noise};
use mapfit::sim::{self, misplaced};
use mapfit::uncertainty::Kind;

const NOISE: Noise = Noise { sigma_x: 0.05, sigma_y: 0.05, sigma_theta: 0.005, sigma_range: 0.02 };

fn main() {
    let argument = |k: usize, usual: usize| std::env::args().nth(k).and_then(|n| n.parse().ok()).unwrap_or(usual);
    let (side, new, joins) = (argument(1, 8), argument(2, 8), argument(3, 20));
    if joins > 0 {
        join(joins as u64);
    }
    if side == 0 {
        return;
    }
    let scans = misplaced(&sim::Survey::halls(side, NOISE.sigma_range, 1).scans, &NOISE, 1);
    for distance in [Distance::Vector, Distance::Signed] {
        compare(distance, &scans, new);
    }
}

/// Offices surveyed by two robots, each in a frame of its own; the second's is guessed 0.3 m and 5 degrees off. How often the
/// truth lies within what is said of it.
fn join(draws: u64) {
    let (mut inside, mut errors, mut sigmas, mut refused) = ([0.0; 4], [0.0f64; 3], [0.0f64; 3], 0);
    for seed in 0..draws {
        let frame = Pose::new(3.0, -2.0, 0.8);
        let all = misplaced(&sim::Survey::office(NOISE.sigma_range, seed).scans, &NOISE, seed);
        let scans: Vec<LaserScan> = all
            .into_iter()
            .enumerate()
            .map(|(k, scan)| if k % 2 == 0 { scan } else { LaserScan { frame: 1, ..moved(&scan, &inverse(&frame)) } })
            .collect();
        let sign = |bit: u64| if seed >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let guess = Pose::new(3.0 + 0.3 * sign(0), -2.0 + 0.3 * sign(1), 0.8 + 0.087 * sign(2));
        let covariance = Cov3::from_diagonal(&[0.16, 0.16, 0.01].into());
        let first = Guess { pose: Pose::new(0.0, 0.0, 0.0), covariance: Cov3::zeros() };
        let places = match aligned(&scans, &[first, Guess { pose: guess, covariance }], &|| true) {
            Ok(places) => places,
            Err(error) => {
                println!("join {seed}: {error}");
                refused += 1;
                continue;
            }
        };
        let placed: Vec<LaserScan> = scans.iter().map(|scan| moved(scan, &places[scan.frame])).collect();
        let map = Survey::new(&placed, NOISE).distance(Distance::Vector).resolution(0.25).map().unwrap();
        let mut told = map.frames[0].clone();
        told.put = places[1];
        let (pose, covariance) = (told.pose(), told.pose_covariance());
        let off = [pose.x - frame.x, pose.y - frame.y, pose.theta - frame.theta];
        for k in 0..3 {
            errors[k] += off[k] * off[k];
            sigmas[k] += covariance[(k, k)];
            inside[k] += f64::from(u8::from(off[k].abs() <= 1.96 * covariance[(k, k)].sqrt()));
        }
        let off = Cov3::from_columns(&[off.into(), [0.0; 3].into(), [0.0; 3].into()]);
        let apart = covariance.cholesky().map_or(f64::INFINITY, |root| root.solve(&off).column(0).dot(&off.column(0)));
        inside[3] += f64::from(u8::from(apart <= 7.81));
    }
    let n = (draws - refused) as f64;
    let rms = |sums: [f64; 3]| sums.map(|sum| (sum / n).sqrt());
    println!("join: {refused} of {draws} refused; rms error {:.4?}, said {:.4?} (m, m, rad)", rms(errors), rms(sigmas));
    println!("join: inside 95 % in x, y, theta and jointly: {:.0?} %", inside.map(|inside| 100.0 * inside / n));
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
