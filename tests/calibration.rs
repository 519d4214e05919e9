//! Uncertainty that can be trusted where it is hard: poses five times as wrong as in experiment 1.
//! `docs/calibration.md` is the whole study, 120 draws a case; this is its sentinel.

use mapfit::geometry::{Pose, wrap_angle};
use mapfit::map::Survey;
use mapfit::sim::Scenario;
use mapfit::uncertainty::Kind;

const DRAWS: u64 = 40;

struct Study {
    /// Share of the seen true boundary within two sigma.
    coverage: f64,
    /// Share of the refined poses' coordinates within two sigma.
    pose_coverage: f64,
    /// Refined over reported pose error, root mean square: position, heading.
    pose_error: [f64; 2],
    /// Median over draws of the root mean square distance at the true boundary, metres.
    boundary_rms: f64,
}

fn study(scenario: &Scenario) -> Study {
    let boundary = scenario.seen_boundary(0.2);
    let (mut held, mut poses_held, mut error, mut rms) = (vec![], vec![], [[0.0; 2]; 2], vec![]);
    for seed in 0..DRAWS {
        let scans = scenario.scans(500 + seed);
        let survey = Survey::new(&scans, scenario.noise).resolution(scenario.resolution).bounds(scenario.bounds);
        let map = survey.map().unwrap();
        let at: Vec<(f64, f64)> = boundary.iter().map(|&p| map.distance(p, Kind::Propagated).unwrap()).collect();
        held.extend(at.iter().map(|(u, sigma)| u.abs() <= 2.0 * sigma));
        rms.push((at.iter().map(|(u, _)| u * u).sum::<f64>() / at.len() as f64).sqrt());
        for (scan, truth) in scenario.poses.iter().enumerate() {
            let off = |pose: &Pose| [pose.x - truth.x, pose.y - truth.y, wrap_angle(pose.theta - truth.theta)];
            let (reported, refined) = (off(&scans[scan].pose), off(&map.poses[scan]));
            for (sums, off) in error.iter_mut().zip([reported, refined]) {
                sums[0] += off[0] * off[0] + off[1] * off[1];
                sums[1] += off[2] * off[2];
            }
            let covariance = map.pose_covariance.propagated[scan];
            poses_held.extend((0..3).map(|a| refined[a].abs() <= 2.0 * covariance[(a, a)].sqrt()));
        }
    }
    rms.sort_by(f64::total_cmp);
    let share = |held: &[bool]| held.iter().filter(|h| **h).count() as f64 / held.len() as f64;
    Study {
        coverage: share(&held),
        pose_coverage: share(&poses_held),
        pose_error: [0, 1].map(|k| f64::sqrt(error[1][k] / error[0][k])),
        boundary_rms: rms[rms.len() / 2],
    }
}

fn five_times_the_pose_noise(mut scenario: Scenario) -> Scenario {
    scenario.noise.sigma_x *= 5.0;
    scenario.noise.sigma_y *= 5.0;
    scenario.noise.sigma_theta *= 5.0;
    scenario
}

/// The U's walls lie where a lattice would pull them to a wrong place: before the common motion was taken out of the
/// fit, coverage here was 0.22.
#[test]
fn bad_poses_do_not_make_the_map_overconfident() {
    let found = study(&five_times_the_pose_noise(Scenario::u_room()));
    println!(
        "U: coverage {:.3}, poses {:.3}, boundary {:.4} m",
        found.coverage, found.pose_coverage, found.boundary_rms
    );
    assert!((0.90..=0.985).contains(&found.coverage) && (0.90..=0.985).contains(&found.pose_coverage));
}

#[test]
fn refining_brings_the_scans_together() {
    let found = study(&five_times_the_pose_noise(Scenario::experiment_one()));
    let [position, heading] = found.pose_error;
    println!("L: pose error {position:.2} of the report's, heading {heading:.2}; coverage {:.3}", found.coverage);
    // What three poses have in common no scan can tell: a third of the variance stays, 0.58 of the error.
    assert!(position <= 0.8 && heading <= 0.45);
    assert!((0.90..=0.985).contains(&found.coverage));
}
