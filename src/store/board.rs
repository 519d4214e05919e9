//! What clients do with jobs.

use std::collections::BTreeMap;

use async_trait::async_trait;

use super::StoreError;
use crate::jobs::{Job, JobStatus, Progress};

/// What a tenant may have when it submits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quota {
    /// Jobs that wait.
    pub queued: i64,
    /// Bytes of maps.
    pub bytes: i64,
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
    /// The job this one tries again.
    pub retry_of: Option<String>,
    /// Seconds from submission in which it has to end.
    pub deadline_seconds: Option<f64>,
    /// What its attempts' spans are under: W3C Trace Context.
    pub traceparent: Option<String>,
    pub quota: Option<Quota>,
}

impl NewJob {
    /// Milliseconds from submission in which it has to end. (In a statement, the sum of a time and nothing is nothing.)
    pub(super) fn deadline(&self) -> Option<i64> {
        self.deadline_seconds.map(|seconds| (seconds * 1000.0) as i64)
    }
}

/// What became of a submission.
#[derive(Debug, Clone, PartialEq)]
pub enum Submission {
    Accepted(Job),
    /// The same key and body were here before.
    Repeated(Job),
    /// The same key was here with another body.
    KeyReused,
    /// The tenant has as much as it may of this.
    OverQuota(&'static str),
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

/// A new name, or none; new labels, or none. What is `None` outside stays as it is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Relabelling {
    pub name: Option<Option<String>>,
    pub labels: Option<BTreeMap<String, String>>,
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

/// Jobs as clients see them. Another tenant's are not there.
#[async_trait]
pub trait JobBoard: Send + Sync {
    async fn submit(&self, job: NewJob) -> Result<Submission, StoreError>;
    async fn job(&self, tenant: &str, id: &str) -> Result<Option<Job>, StoreError>;
    async fn jobs(&self, listing: &Listing) -> Result<Vec<Job>, StoreError>;
    async fn request(&self, tenant: &str, id: &str) -> Result<Option<Vec<u8>>, StoreError>;
    async fn cancel(&self, tenant: &str, id: &str) -> Result<Cancellation, StoreError>;
    async fn relabel_job(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<Job>, StoreError>;
    /// Removes a job that has ended, where its map is gone, with its request and its idempotency key.
    async fn remove_job(&self, tenant: &str, id: &str) -> Result<Removal, StoreError>;
    /// The revisions of these jobs, of any tenant; what is gone is left out.
    async fn revisions(&self, ids: &[String]) -> Result<Vec<(String, i64)>, StoreError>;
}
