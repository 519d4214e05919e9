//! Robot logs into job requests.
//!
//! `carmen` reads CARMEN logs, `mcap` ROS 2 recordings, `log` whichever of them it is; `corridor` the shared data's simulated
//! one; `odometry` says how uncertain poses grow along the way. What comes out is the contract's JSON, so a log goes the
//! way any client's job goes.

mod carmen;
mod corridor;
mod job;
mod log;
mod mcap;
mod odometry;

use thiserror::Error;

pub use carmen::parse_carmen;
pub use corridor::{CorridorError, parse_corridor};
pub use job::{job_json, to_request};
pub use log::{Log, LogError, list_log, read_log};
pub use mcap::{Ask, GoesOn, Limits as RecordingLimits, RecordingError, Source};
pub use odometry::Odometry;

use crate::geometry::wrap_angle;
use crate::scan::LaserScan;

#[derive(Debug, Error, PartialEq)]
pub enum ImportError {
    #[error("line {line}: {detail}")]
    Line { line: usize, detail: String },
    #[error("the log has no FLASER line, so no scan")]
    NoScans,
}

/// A heading in (-pi, pi], to a picoradian: so that it is the same number whether a log wrote it as an angle of any size
/// or as a quaternion. A fit decides some things sharply, and should not decide them by the last bit of a heading.
fn heading(theta: f64) -> f64 {
    (wrap_angle(theta) * 1e12).round() / 1e12
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
    /// Whether the scan with this index is taken.
    pub fn takes(&self, index: usize) -> bool {
        index >= self.from
            && self.to.is_none_or(|to| index < to)
            && (index - self.from).is_multiple_of(self.every.max(1))
    }

    /// The selected scans, in their order.
    pub fn of(&self, scans: Vec<LaserScan>) -> Vec<LaserScan> {
        let end = self.to.unwrap_or(usize::MAX).min(scans.len());
        let span = end.saturating_sub(self.from);
        scans.into_iter().skip(self.from).take(span).step_by(self.every.max(1)).collect()
    }
}
