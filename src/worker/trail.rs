//! The spans of one attempt: where its time goes, stage by stage, also where it comes to nothing.

use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use opentelemetry::trace::SpanKind;

use crate::jobs::Job;
use crate::traces::{Span, Traces, context_of};

pub(super) struct Trail {
    traces: Traces,
    attempt: Span,
    /// The stage that is under way.
    stage: Mutex<Option<(&'static str, Span)>>,
}

impl Trail {
    /// Begins when the claim was asked for, and has that for its first stage.
    pub fn of(traces: &Traces, job: &Job, asked: SystemTime) -> Self {
        let submission = job.traceparent.as_deref().and_then(context_of).unwrap_or_default();
        let attempt = traces.begin("attempt", SpanKind::Consumer, &submission, Some(asked));
        attempt.set("mapfit.job.id", job.id.clone());
        attempt.set("mapfit.tenant", job.tenant.clone());
        attempt.set("mapfit.attempt", job.attempt);
        drop(traces.begin("claim", SpanKind::Client, attempt.context(), Some(asked)));
        Self { traces: traces.clone(), attempt, stage: Mutex::default() }
    }

    /// Ends the stage before, where that is another.
    pub fn enter(&self, stage: &'static str) {
        let mut current = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        if current.as_ref().is_none_or(|(before, _)| *before != stage) {
            // First the old one ends, then the new one begins.
            *current = None;
            *current = Some((stage, self.traces.begin(stage, SpanKind::Internal, self.attempt.context(), None)));
        }
    }

    /// Says of the stage that is under way, and of the attempt, why they came to nothing.
    pub fn fail(&self, why: &str) {
        let current = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        for span in current.iter().map(|(_, span)| span).chain([&self.attempt]) {
            span.fail(why.to_owned());
        }
    }

    /// How the attempt ended.
    pub fn ended(&self, outcome: &'static str) {
        self.attempt.set("mapfit.outcome", outcome);
    }
}

impl Drop for Trail {
    /// The stage ends before the attempt does.
    fn drop(&mut self) {
        self.stage.get_mut().unwrap_or_else(PoisonError::into_inner).take();
    }
}
