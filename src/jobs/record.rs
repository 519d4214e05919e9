//! What is known of a job: the vocabulary of OGC API - Processes.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::fit::Distance;
use crate::map::FitReport;
use crate::spline::Lattice;

/// Where a job stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum JobStatus {
    /// Waiting for a worker.
    Accepted,
    Running,
    Successful,
    Failed,
    /// Cancelled by a client.
    Dismissed,
}

impl JobStatus {
    pub const ALL: [Self; 5] = [Self::Accepted, Self::Running, Self::Successful, Self::Failed, Self::Dismissed];

    pub fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Running => "running",
            Self::Successful => "successful",
            Self::Failed => "failed",
            Self::Dismissed => "dismissed",
        }
    }

    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }

    pub fn has_ended(self) -> bool {
        matches!(self, Self::Successful | Self::Failed | Self::Dismissed)
    }
}

/// How far a job is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Progress {
    /// 0 to 100; an estimate while the fit runs.
    pub percent: f64,
    /// `queued`, `preparing`, `waiting for memory`, `aligning` (of a join), `fitting`, `covariance`, `storing` or `done`.
    pub stage: String,
    pub iteration: usize,
    pub max_iterations: usize,
    pub objective: Option<f64>,
    /// Of a job that is fitted in parts; told beside the progress, not with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(ignore)]
    pub parts: Option<Parts>,
}

/// How many parts a job has, and how far they are: branches of the elimination, each of which is a thread's. A fit passes
/// over all of them several times, and its covariance once more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Parts {
    pub total: usize,
    /// In this pass.
    pub done: usize,
    pub running: usize,
}

/// Why a job failed, in the members of RFC 9457.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProblemReport {
    pub r#type: String,
    pub title: String,
    pub status: u16,
    pub detail: String,
}

/// A job as the store keeps it. Times are milliseconds since 1970, by the database's clock.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    pub id: String,
    pub tenant: String,
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    pub status: JobStatus,
    pub progress: Progress,
    pub message: Option<String>,
    pub created: i64,
    pub started: Option<i64>,
    pub finished: Option<i64>,
    pub updated: i64,
    pub attempt: i64,
    pub priority: i32,
    pub map_id: Option<String>,
    pub problem: Option<ProblemReport>,
    /// Grows with every change; the id of the job's latest event.
    pub revision: i64,
    /// The job that this one tries again.
    pub retry_of: Option<String>,
    pub deadline: Option<i64>,
    /// What its attempts' spans are under: W3C Trace Context.
    pub traceparent: Option<String>,
}

/// A finished map as the store keeps it; its arrays are artifacts under `prefix`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapRecord {
    pub id: String,
    pub job_id: String,
    pub tenant: String,
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    pub created: i64,
    pub distance: Distance,
    pub lattice: Lattice,
    pub fit: FitReport,
    pub prefix: String,
    /// Of its file, with the SHA-256 in hexadecimal where it is known.
    pub bytes: i64,
    pub sha256: Option<String>,
    /// The map that this one grew from, and how many came before it.
    pub parent: Option<String>,
    pub version: i64,
}
