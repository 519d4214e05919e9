//! What workers do with jobs: every write but a claim is fenced by the attempt.

use std::time::Duration;

use async_trait::async_trait;

use super::StoreError;
use crate::jobs::{Job, MapRecord, ProblemReport, Progress};

/// Who claims, and on what terms.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    pub worker: String,
    /// How long a claim holds without a heartbeat.
    pub lease: Duration,
    /// Jobs of one tenant that run at once, at most.
    pub running_a_tenant: i64,
}

/// A job a worker holds, with its request.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    pub job: Job,
    pub request: Vec<u8>,
}

/// Jobs as workers hold them; see [the module](super) for what this promises.
#[async_trait]
pub trait Leases: Send + Sync {
    async fn claim(&self, terms: &Terms) -> Result<Option<Claim>, StoreError>;
    async fn heartbeat(&self, id: &str, attempt: i64, progress: &Progress, lease: Duration)
    -> Result<bool, StoreError>;
    /// The job and its map are written together.
    async fn succeed(&self, attempt: i64, map: &MapRecord, done: &Progress) -> Result<bool, StoreError>;
    async fn fail(&self, id: &str, attempt: i64, problem: &ProblemReport) -> Result<bool, StoreError>;
    /// Back to the queue after a delay, at the cost of the attempt.
    async fn retry(
        &self,
        id: &str,
        attempt: i64,
        delay: Duration,
        message: &str,
        progress: &Progress,
    ) -> Result<bool, StoreError>;
    /// Back to the queue as if it had never been claimed.
    async fn release(&self, id: &str, attempt: i64, progress: &Progress) -> Result<bool, StoreError>;
}
