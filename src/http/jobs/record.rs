//! A job, as clients see it.

use std::collections::BTreeMap;

use serde::Serialize;
use utoipa::ToSchema;

use crate::http::shared::page::timestamp;
use crate::jobs::{Job, JobStatus, Parts, ProblemReport, Progress};

/// A job.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Job)]
pub struct JobBody {
    #[schema(format = "uuid")]
    pub id: String,
    #[schema(required)]
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    pub status: JobStatus,
    pub progress: Progress,
    #[schema(required)]
    pub message: Option<String>,
    #[schema(format = "date-time", required)]
    pub created: Option<String>,
    #[schema(format = "date-time", required)]
    pub started: Option<String>,
    #[schema(format = "date-time", required)]
    pub finished: Option<String>,
    #[schema(format = "date-time", required)]
    pub updated: Option<String>,
    /// How often the job was begun.
    pub attempt: i64,
    pub priority: i32,
    /// Set once successful.
    #[schema(required)]
    pub map_id: Option<String>,
    /// Set once failed.
    #[schema(required)]
    pub problem: Option<ProblemReport>,
    /// The job that this one tries again.
    #[schema(required)]
    pub retry_of: Option<String>,
    /// Past it the job has failed.
    #[schema(format = "date-time", required)]
    pub deadline: Option<String>,
    /// Of a job that is fitted in parts; null for an undivided one.
    #[schema(required)]
    pub parts: Option<Parts>,
    /// Addresses by relation: self, events, request, and map once there is one.
    pub links: BTreeMap<&'static str, String>,
}

impl From<Job> for JobBody {
    fn from(job: Job) -> Self {
        let itself = format!("/v1/jobs/{}", job.id);
        let mut links =
            BTreeMap::from([("events", format!("{itself}/events")), ("request", format!("{itself}/request"))]);
        links.insert("self", itself);
        if let Some(map_id) = &job.map_id {
            links.insert("map", format!("/v1/maps/{map_id}"));
        }
        Self {
            id: job.id,
            name: job.name,
            labels: job.labels,
            status: job.status,
            // The last heartbeat of an attempt that failed may have had some running.
            parts: job.progress.parts.map(|own| match job.status {
                JobStatus::Running => own,
                _ => Parts { running: 0, ..own },
            }),
            progress: Progress { parts: None, ..job.progress },
            message: job.message,
            created: timestamp(job.created),
            started: job.started.and_then(timestamp),
            finished: job.finished.and_then(timestamp),
            updated: timestamp(job.updated),
            attempt: job.attempt,
            priority: job.priority,
            map_id: job.map_id,
            problem: job.problem,
            retry_of: job.retry_of,
            deadline: job.deadline.and_then(timestamp),
            links,
        }
    }
}
