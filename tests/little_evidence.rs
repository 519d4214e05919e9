//! Whatever little was seen: a map whose every answer is a number and every variance positive, or a reason why not.

use mapfit::fit::{Distance, FitOptions, Poses};
use mapfit::geometry::{Pose, Vec2};
use mapfit::map::{FittedMap, Survey};
use mapfit::scan::{LaserScan, Noise};
use mapfit::uncertainty::Kind;
use proptest::prelude::*;

fn scan(pose: Pose, angle_min: f64, angle_increment: f64, ranges: Vec<f64>) -> LaserScan {
    LaserScan {
        pose,
        pose_covariance: None,
        sigma_range: None,
        frame: 0,
        angle_min,
        angle_increment,
        range_min: 0.05,
        range_max: 20.0,
        ranges,
    }
}

/// Scans of few beams, some without a return; many from one place; all of them alike; one wall and nothing else.
fn scans() -> impl Strategy<Value = Vec<LaserScan>> {
    let pose = (-2.0..2.0f64, -2.0..2.0f64, -3.0..3.0f64).prop_map(|(x, y, theta)| Pose::new(x, y, theta));
    let range = prop_oneof![3 => 0.2..4.0f64, 1 => Just(f64::NAN)];
    let any = (pose.clone(), prop::collection::vec(range, 1..12), 0.01..0.4f64)
        .prop_map(|(pose, ranges, step)| scan(pose, -0.5, step, ranges));
    let one_beam = (pose.clone(), 0.2..4.0f64).prop_map(|(pose, range)| vec![scan(pose, 0.0, 0.1, vec![range])]);
    let wall = (0.5..3.0f64, 2..30usize).prop_map(|(far, beams)| {
        let bearing = |k: usize| -0.6 + 1.2 * k as f64 / beams as f64;
        let ranges = (0..beams).map(|k| far / bearing(k).cos()).collect();
        vec![scan(Pose::new(0.0, 0.0, 0.0), -0.6, 1.2 / beams as f64, ranges)]
    });
    let repeated = (any.clone(), 2..6usize).prop_map(|(one, times)| vec![one; times]);
    prop_oneof![4 => prop::collection::vec(any, 1..5), 1 => one_beam, 1 => wall, 1 => repeated]
}

fn check(map: &FittedMap) {
    for kind in Kind::ALL {
        for (name, variances) in map.field.variances(kind) {
            let bad = variances.iter().filter(|v| !(v.is_nan() || v.is_finite() && **v > 0.0)).count();
            assert_eq!(bad, 0, "{name} {kind:?}");
        }
        let area = map.lattice().bounds();
        for k in 0..400 {
            let share = [f64::from(k % 20) / 19.0, f64::from(k / 20) / 19.0];
            let at = |axis: usize| area.min[axis] + share[axis] * (area.max[axis] - area.min[axis]);
            let Some(answer) = map.query(Vec2::new(at(0), at(1)), kind) else { continue };
            assert!(answer.distance.is_finite() && answer.sigma.is_finite() && answer.sigma > 0.0, "{answer:?}");
            assert!(answer.gradient.iter().all(|v| v.is_finite()));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn every_variance_is_positive_or_there_is_no_map(
        scans in scans(), vector in any::<bool>(), fixed in any::<bool>(), h in 0.15..0.6f64, sigma in 0.001..0.2f64,
    ) {
        let noise = Noise { sigma_x: sigma, sigma_y: sigma, sigma_theta: 0.3 * sigma, sigma_range: 0.02 };
        let distance = if vector { Distance::Vector } else { Distance::Signed };
        let poses = if fixed { Poses::Fixed } else { Poses::Refined };
        let options = FitOptions { poses: Some(poses), max_iterations: 40, ..FitOptions::default() };
        let survey = Survey::new(&scans, noise).distance(distance).resolution(h).options(options);
        match survey.map() {
            Ok(map) => check(&map),
            Err(error) => prop_assert!(error.to_string().len() > 20, "{error}"),
        }
    }
}
