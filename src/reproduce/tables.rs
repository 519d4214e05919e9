//! Tables I and II: the experiments' noise, as published, and as the simulated draws have it.

use super::Table;
use crate::geometry::wrap_angle;
use crate::scan::{LaserScan, Noise};
use crate::sim::{Scenario, Survey, misplaced};

/// Draws whose spread is measured.
const DRAWS: u64 = 100;

pub fn experiment_one(scenario: &Scenario) -> Table {
    let exact = Scenario {
        noise: Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range: 0.0 },
        ..scenario.clone()
    };
    let truth = exact.scans(0);
    let drawn = spread(&truth, (0..DRAWS).map(|seed| scenario.scans(seed)));
    let mut rows = noise_rows(&scenario.noise, &drawn);
    rows.extend([
        row("spacing of control points h", "0.2 m", "0.2 m"),
        row("poses x beams, field of view", "3 x not printed, 180 deg", "3 x 181, 180 deg"),
    ]);
    Table { name: "table-1".into(), title: "Table I: experiment 1, the L-shaped room".into(), rows }
}

pub fn experiment_two() -> Table {
    let truth = Survey::office(0.0, 0);
    let noisy =
        |seed| misplaced(&Survey::office(Noise::EXPERIMENT_TWO.sigma_range, seed).scans, &Noise::EXPERIMENT_TWO, seed);
    let drawn = spread(&truth.scans, (0..DRAWS / 10).map(noisy));
    let mut rows = noise_rows(&Noise::EXPERIMENT_TWO, &drawn);
    rows.extend([
        row("spacing of control points h", "0.25 m", "0.25 m"),
        row("field of view", "270 deg", "270 deg, 271 beams"),
    ]);
    Table { name: "table-2".into(), title: "Table II: experiment 2, the office".into(), rows }
}

fn row(quantity: &str, published: &str, here: &str) -> Vec<String> {
    [quantity, published, here].map(str::to_owned).to_vec()
}

fn noise_rows(published: &Noise, drawn: &Noise) -> Vec<Vec<String>> {
    let metres =
        |name: &str, published: f64, drawn: f64| row(name, &format!("{published} m"), &format!("{drawn:.4} m"));
    vec![
        row("quantity", "published", "here (spread of the draws)"),
        metres("sigma_x", published.sigma_x, drawn.sigma_x),
        metres("sigma_y", published.sigma_y, drawn.sigma_y),
        row("sigma_theta", &format!("{} rad", published.sigma_theta), &format!("{:.5} rad", drawn.sigma_theta)),
        metres("sigma_range", published.sigma_range, drawn.sigma_range),
    ]
}

/// Standard deviations of drawn scans about the true ones.
fn spread(truth: &[LaserScan], draws: impl Iterator<Item = Vec<LaserScan>>) -> Noise {
    let (mut poses, mut ranges) = ([0.0; 3], 0.0);
    let (mut scans, mut beams) = (0.0, 0.0);
    for (scan, exact) in draws.flatten().zip(truth.iter().cycle()) {
        let (own, exact_pose) = (scan.pose, exact.pose);
        let errors = [own.x - exact_pose.x, own.y - exact_pose.y, wrap_angle(own.theta - exact_pose.theta)];
        poses.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error);
        scans += 1.0;
        for error in (0..scan.ranges.len()).filter_map(|beam| Some(scan.range(beam)? - exact.range(beam)?)) {
            ranges += error * error;
            beams += 1.0;
        }
    }
    let [sigma_x, sigma_y, sigma_theta] = poses.map(|sum| f64::sqrt(sum / scans));
    Noise { sigma_x, sigma_y, sigma_theta, sigma_range: f64::sqrt(ranges / beams) }
}
