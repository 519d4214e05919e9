//! Where jobs and maps are kept: a [`JobStore`] for their records, [`Artifacts`] for their arrays.
//!
//! The promises, which every implementation keeps and one conformance suite checks:
//!
//! - Accepted is durable: the row is committed before the answer is sent, its idempotency key in the same transaction.
//! - A claim takes one job, by priority, then by how few jobs of its tenant run, then by age, and raises `attempt`.
//! - Every later write is fenced by `id AND attempt AND status = 'running'`. `false` means the lease is lost: the solver
//!   stops, and nothing was written. A late worker can never overwrite a newer result.
//! - Leases live by the database's clock. A lapsed lease costs an attempt; a job out of attempts has failed.

mod artifacts;
mod listed;
mod sqlite;

use std::collections::BTreeMap;

use async_trait::async_trait;
use thiserror::Error;

pub use artifacts::{Artifacts, ArtifactsError};
pub use sqlite::SqliteStore;

use crate::jobs::{Job, JobStatus, MapRecord, ProblemReport, Progress};

#[derive(Debug, Error)]
pub enum StoreError {
    #[error("the database did not answer: {0}")]
    Database(#[from] sqlx::Error),
    #[error("the database could not be set up: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    #[error("a stored record is damaged: {0}")]
    Damaged(#[from] serde_json::Error),
    #[error("a stored record is damaged: unknown status {0}")]
    Status(String),
    #[error("a stored record is damaged: unknown distance {0}")]
    Distance(String),
}

/// A job to be accepted.
#[derive(Debug, Clone)]
pub struct NewJob {
    pub tenant: String,
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    pub priority: i32,
    pub progress: Progress,
    pub message: Option<String>,
    /// The request's JSON, compressed by the caller.
    pub request: Vec<u8>,
    /// The client's idempotency key, and a digest of the request's body.
    pub idempotency: Option<(String, String)>,
}

/// What became of a submission.
#[derive(Debug, Clone, PartialEq)]
pub enum Submission {
    Accepted(Job),
    /// The same key and body were here before.
    Repeated(Job),
    /// The same key was here with another body.
    KeyReused,
}

/// A job a worker holds, with its request.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    pub job: Job,
    pub request: Vec<u8>,
}

/// What became of a cancellation.
#[derive(Debug, Clone, PartialEq)]
pub enum Cancellation {
    Dismissed(Job),
    AlreadyEnded(Job),
    Unknown,
}

/// What became of a removal.
#[derive(Debug, Clone, PartialEq)]
pub enum Removal {
    Removed,
    NotEnded,
    /// Its map, by id, is still there.
    HasMap(String),
    Unknown,
}

/// Which jobs or maps to list: newest first, those with ids below `before`.
#[derive(Debug, Clone, Default)]
pub struct Listing {
    pub tenant: String,
    pub status: Option<JobStatus>,
    pub labels: Vec<(String, String)>,
    /// minx, miny, maxx, maxy; maps that touch it.
    pub bbox: Option<[f64; 4]>,
    pub before: Option<String>,
    pub limit: i64,
}

/// How long a claim holds without a heartbeat.
pub const LEASE: std::time::Duration = std::time::Duration::from_secs(10);
/// How often a job may be begun.
pub const MAX_ATTEMPTS: i64 = 3;

/// The records of jobs and maps; see the module for what it promises.
#[async_trait]
pub trait JobStore: Send + Sync {
    async fn submit(&self, job: NewJob) -> Result<Submission, StoreError>;
    async fn job(&self, tenant: &str, id: &str) -> Result<Option<Job>, StoreError>;
    async fn jobs(&self, listing: &Listing) -> Result<Vec<Job>, StoreError>;
    async fn request(&self, tenant: &str, id: &str) -> Result<Option<Vec<u8>>, StoreError>;
    async fn cancel(&self, tenant: &str, id: &str) -> Result<Cancellation, StoreError>;
    /// Removes a job that has ended, where its map is gone, with its request and its idempotency key.
    async fn remove_job(&self, tenant: &str, id: &str) -> Result<Removal, StoreError>;
    /// The revisions of these jobs, of any tenant; what is gone is left out.
    async fn revisions(&self, ids: &[String]) -> Result<Vec<(String, i64)>, StoreError>;

    async fn claim(&self, worker: &str) -> Result<Option<Claim>, StoreError>;
    /// Puts jobs whose lease lapsed back in the queue, or fails them where they are out of attempts; how many.
    async fn reap(&self) -> Result<u64, StoreError>;
    /// Fenced.
    async fn heartbeat(&self, id: &str, attempt: i64, progress: &Progress) -> Result<bool, StoreError>;
    /// Fenced; the job and its map are written together.
    async fn succeed(&self, attempt: i64, map: &MapRecord) -> Result<bool, StoreError>;
    /// Fenced.
    async fn fail(&self, id: &str, attempt: i64, problem: &ProblemReport) -> Result<bool, StoreError>;
    /// Fenced; back to the queue after `delay`, at the cost of the attempt.
    async fn retry(&self, id: &str, attempt: i64, delay: std::time::Duration, why: &str) -> Result<bool, StoreError>;
    /// Fenced; back to the queue as if it had never been claimed.
    async fn release(&self, id: &str, attempt: i64) -> Result<bool, StoreError>;

    async fn map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError>;
    async fn maps(&self, listing: &Listing) -> Result<Vec<MapRecord>, StoreError>;
    /// The deleted map, or `None` where there was none.
    async fn delete_map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError>;
    /// Whether some map or running attempt owns an artifact prefix.
    async fn owns_prefix(&self, prefix: &str, job_id: &str, attempt: i64) -> Result<bool, StoreError>;
    /// Whether work can be taken: reads what every request needs, and commits a row.
    async fn probe(&self) -> Result<(), StoreError>;
}
