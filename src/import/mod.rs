//! Robot logs into job requests.
//!
//! `carmen` reads CARMEN logs, `corridor` the shared data's simulated one; `odometry` says how uncertain poses grow
//! along the way. What comes out is the contract's JSON, so a log goes the way any client's job goes.

mod carmen;
mod corridor;
mod odometry;

use serde_json::{Value, json};
use thiserror::Error;

pub use carmen::parse_carmen;
pub use corridor::{CorridorError, parse_corridor};
pub use odometry::Odometry;

use crate::scan::{LaserScan, Noise};

#[derive(Debug, Error, PartialEq)]
pub enum ImportError {
    #[error("line {line}: {detail}")]
    Line { line: usize, detail: String },
    #[error("the log has no FLASER line, so no scan")]
    NoScans,
}

/// Which scans of a log to take, and what to ask of the map.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// Every so many scans.
    pub every: usize,
    /// The first scan taken, counted from 0.
    pub from: usize,
    /// One past the last; to the end where `None`.
    pub to: Option<usize>,
}

impl Default for Selection {
    fn default() -> Self {
        Self { every: 1, from: 0, to: None }
    }
}

impl Selection {
    /// The selected scans, in their order.
    pub fn of(&self, scans: Vec<LaserScan>) -> Vec<LaserScan> {
        let end = self.to.unwrap_or(usize::MAX).min(scans.len());
        let span = end.saturating_sub(self.from);
        scans.into_iter().skip(self.from).take(span).step_by(self.every.max(1)).collect()
    }
}

/// A job request for scans, as the contract has it; `distance` is `sdf` or `vdf`.
pub fn to_request(
    scans: &[LaserScan],
    noise: &Noise,
    name: Option<&str>,
    (distance, resolution): (&str, f64),
) -> Value {
    let scans: Vec<Value> = scans
        .iter()
        .map(|scan| {
            // NaN is written as null: no return.
            let mut one = json!({
                "pose": scan.pose,
                "angle_min": scan.angle_min,
                "angle_increment": scan.angle_increment,
                "range_min": scan.range_min,
                "range_max": scan.range_max,
                "ranges": scan.ranges,
            });
            if let Some(covariance) = &scan.pose_covariance {
                one["pose_covariance"] = json!(covariance.as_slice());
            }
            one
        })
        .collect();
    json!({
        "name": name,
        "scans": scans,
        "noise": {
            "sigma_x": noise.sigma_x,
            "sigma_y": noise.sigma_y,
            "sigma_theta": noise.sigma_theta,
            "sigma_range": noise.sigma_range,
        },
        "map": {"distance": distance, "resolution": resolution},
    })
}
