//! What keeps a store in order, whoever uses it.

use std::time::Duration;

use async_trait::async_trait;

use super::StoreError;
use crate::jobs::lifecycle::Verdict;
use crate::jobs::{Job, MapRecord};

/// What a tenant has now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Holdings {
    pub queued: i64,
    pub running: i64,
    pub maps: i64,
    /// Of maps.
    pub bytes: i64,
}

/// Tenants with at most so many waiting jobs are light, the others heavy: classes that are two, however many tenants
/// there are. Where heavy ones wait it is somebody's burst; where light ones do, there is too little of something for
/// all.
pub const LIGHT: i64 = 10;

/// What a class of tenants has now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Total {
    pub held: Holdings,
    /// The age of its oldest waiting job, milliseconds.
    pub oldest: Option<i64>,
}

/// What all tenants have now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Totals {
    pub light: Total,
    pub heavy: Total,
}

impl Totals {
    /// Of counts and ages a class, as a database has them: heavy or not, then its numbers.
    pub(super) fn of(held: Vec<(bool, i64, i64, i64, i64)>, oldest: Vec<(bool, Option<i64>)>) -> Self {
        let mut totals = Self::default();
        for (is_heavy, queued, running, maps, bytes) in held {
            totals.class(is_heavy).held = Holdings { queued, running, maps, bytes };
        }
        for (is_heavy, age) in oldest {
            totals.class(is_heavy).oldest = age;
        }
        totals
    }

    fn class(&mut self, is_heavy: bool) -> &mut Total {
        if is_heavy { &mut self.heavy } else { &mut self.light }
    }
}

/// A prefix of artifacts, and the attempt that wrote there; no job has an empty id.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    pub prefix: String,
    pub job_id: String,
    pub attempt: i64,
}

/// Who says what becomes of a job.
pub type Judge = for<'a> fn(&'a Job) -> Verdict;

#[async_trait]
pub trait Housekeeping: Send + Sync {
    /// Does with jobs whose lease lapsed what the verdict says, and fails those past their deadline; how many.
    async fn reap(&self, verdict: Judge) -> Result<u64, StoreError>;
    /// Of each, whether a map has the prefix or the attempt of this number runs: whichever prefix of its number is that
    /// attempt's.
    async fn owned(&self, written: &[Written]) -> Result<Vec<bool>, StoreError>;
    /// Whether work can be taken: reads what every request needs, and commits a row.
    async fn probe(&self) -> Result<(), StoreError>;
    /// Maps whose age is above this and that no place names, with their ages, the oldest first; those that follow `after`, the
    /// time one was created at and its id.
    async fn maps_older_than(
        &self,
        age: Duration,
        after: (i64, &str),
        limit: i64,
    ) -> Result<Vec<(MapRecord, Duration)>, StoreError>;
    async fn holdings(&self, tenant: &str) -> Result<Holdings, StoreError>;
    async fn totals(&self) -> Result<Totals, StoreError>;
}
