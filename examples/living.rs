//! How well joined frames are known, on simulated offices: the figures of `docs/living-maps.md`.
//! `cargo run --release --example living -- [draws]`

use mapfit::fit::Distance;
use mapfit::geometry::inverse;
use mapfit::geometry::{Cov3, Pose};
use mapfit::living::{Guess, aligned, moved};
use mapfit::map::Survey;
use mapfit::scan::{LaserScan, Noise};
use mapfit::sim::{self, misplaced};

const NOISE: Noise = Noise { sigma_x: 0.05, sigma_y: 0.05, sigma_theta: 0.005, sigma_range: 0.02 };

fn main() {
    join(std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(20));
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
