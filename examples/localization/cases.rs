//! Scans to be located: priors that are off by so much, and the file that `benches/localization/peers.py` reads.

use mapfit::geometry::{Cov3, Pose};
use mapfit::localize::{Located, Prior, Sighted};
use mapfit::scan::LaserScan;
use rand::{RngExt, SeedableRng};
use serde_json::{Value, json};

use crate::NOISE;

fn off_by(truth: &Pose, metres: f64, degrees: f64, draw: &mut rand_chacha::ChaCha8Rng) -> Pose {
    let angle: f64 = draw.random_range(0.0..std::f64::consts::TAU);
    let turn = if draw.random_bool(0.5) { degrees } else { -degrees };
    Pose::new(truth.x + metres * angle.cos(), truth.y + metres * angle.sin(), truth.theta + turn.to_radians())
}

/// Scans with priors that are off by so much, drawn.
pub fn sighted(scans: &[LaserScan], starts: Option<(f64, f64)>, seed: u64) -> Vec<Sighted> {
    let mut draw = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    scans
        .iter()
        .map(|scan| {
            let prior = starts.map(|(metres, degrees)| {
                let (spread, turn) = (metres.powi(2), degrees.to_radians().powi(2));
                Prior::new(
                    off_by(&scan.pose, metres, degrees, &mut draw),
                    Cov3::from_diagonal(&[spread, spread, turn].into()),
                )
            });
            Sighted { scan: scan.clone(), prior, sigma_range: NOISE.sigma_range }
        })
        .collect()
}

pub fn written(scan: &LaserScan) -> Value {
    let ranges: Vec<Option<f64>> = (0..scan.ranges.len()).map(|k| scan.range(k)).collect();
    let [angle_min, angle_increment] = [scan.angle_min, scan.angle_increment];
    let [range_min, range_max] = [scan.range_min, scan.range_max];
    json!({"pose": triple(&scan.pose), "angle_min": angle_min, "angle_increment": angle_increment,
           "range_min": range_min, "range_max": range_max, "ranges": ranges})
}

fn triple(pose: &Pose) -> [f64; 3] {
    [pose.x, pose.y, pose.theta]
}

/// A case for the peers: scans whose truth is their pose, from where they were looked for, and what was found.
pub fn case(name: &str, sighted: &[Sighted], located: &[Located], seconds: f64) -> Value {
    let ours = |own: &Located| {
        let (pose, covariance) = (own.pose?, own.covariance?);
        Some(json!({"pose": triple(&pose), "covariance": covariance.as_slice()}))
    };
    let one = |(own, found): (&Sighted, &Located)| {
        json!({"truth": triple(&own.scan.pose), "start": own.prior.map(|prior| triple(&prior.pose)),
               "scan": written(&own.scan), "ours": ours(found)})
    };
    let scans: Vec<Value> = sighted.iter().zip(located).map(one).collect();
    let prior = sighted[0].prior.map(|prior| [0, 1, 2].map(|k| prior.covariance[(k, k)]));
    json!({"name": name, "prior": prior, "scans": scans, "seconds": seconds})
}
