//! How a job goes from state to state: what every store does alike, and none decides.

use std::time::Duration;

use super::{Job, Parts, ProblemReport, Progress};
use crate::map::FitReport;

/// How often a job may be begun.
pub const MAX_ATTEMPTS: i64 = 3;
/// The first delay before a retry; it doubles with every attempt.
const FIRST_BACKOFF: Duration = Duration::from_secs(1);

/// What becomes of a job whose attempt did not end by itself.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Back to the queue, with this message.
    Again(String),
    Failed(ProblemReport),
}

/// The verdict on a running job whose lease lapsed.
pub fn after_lapse(job: &Job) -> Verdict {
    if job.attempt < MAX_ATTEMPTS {
        return Verdict::Again("its worker was lost; it runs again".into());
    }
    Verdict::Failed(ProblemReport {
        r#type: "/problems/attempts-exhausted".into(),
        title: "The job's worker died too often".into(),
        status: 500,
        detail: format!("the job was begun {MAX_ATTEMPTS} times and no worker finished it; it will not be run again"),
    })
}

/// The problem of a job that did not end before its deadline.
pub fn past_deadline() -> ProblemReport {
    ProblemReport {
        r#type: "/problems/deadline-passed".into(),
        title: "The job's deadline has passed".into(),
        status: 504,
        detail: "the job had not ended deadline_seconds after its submission".into(),
    }
}

/// The message of a job that goes back to the queue because an attempt failed.
pub fn runs_again(attempt: i64, why: &str) -> String {
    format!("attempt {attempt} did not finish, it runs again: {why}")
}

/// How long a job waits after an attempt failed.
pub fn backoff(attempt: i64) -> Duration {
    FIRST_BACKOFF * 2u32.saturating_pow(u32::try_from(attempt.clamp(1, 10)).unwrap_or(1) - 1)
}

impl Progress {
    /// Of a job that waits for a worker.
    pub fn queued(max_iterations: usize) -> Self {
        Self { percent: 0.0, stage: "queued".into(), iteration: 0, max_iterations, objective: None, parts: None }
    }

    /// Of a job that goes back to the queue: nothing is done yet.
    pub fn again(&self) -> Self {
        let parts = self.parts.map(|parts| Parts { done: 0, running: 0, ..parts });
        Self { parts, ..Self::queued(self.max_iterations) }
    }

    /// Of a job that has its map. The largest number of steps stays the request's.
    pub fn done(self, fit: &FitReport) -> Self {
        let parts = self.parts.map(|parts| Parts { done: parts.total, running: 0, ..parts });
        let (iteration, objective) = (fit.iterations, Some(fit.objective));
        Self { percent: 100.0, stage: "done".into(), iteration, objective, parts, ..self }
    }
}
