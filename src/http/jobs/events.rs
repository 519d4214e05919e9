//! A job's life as server-sent events: `progress` while it goes on, and last `status`.
//!
//! An event's id is the job's revision, which grows with every change; `Last-Event-ID` resumes behind it. A client that
//! has seen the end gets 204, which tells an `EventSource` to stop. Changes come from [`crate::worker::Workshop`], which
//! looks after all jobs that anybody follows by one read of the store.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures::stream::{self, Stream, StreamExt};

use super::record::JobBody;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller};
use crate::jobs::Job;

/// Proxies are told not to hold events back.
static UNBUFFERED: (HeaderName, HeaderValue) =
    (HeaderName::from_static("x-accel-buffering"), HeaderValue::from_static("no"));

/// Follow a job.
#[utoipa::path(get, operation_id = "get_job_events", path = "/v1/jobs/{id}/events", tag = "jobs", security(("key" = ["read"])),
    params(("id" = String, Path), ("Last-Event-ID" = Option<String>, Header, description = "resume behind this event")),
    responses((status = 200, body = serde_json::Value, content_type = "text/event-stream",
            description = "`progress` events, each with the job's progress, and last one `status` event with the job"),
        (status = 204, description = "the job has ended and its last event was seen"),
        Refused))]
pub async fn get_job_events(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    Params::of(&uri).finish()?;
    let job = state.job(&caller, &id).await?;
    let seen = headers.get("last-event-id").and_then(|id| id.to_str().ok()).and_then(|id| id.trim().parse().ok());
    let seen: i64 = seen.unwrap_or(0);
    if job.status.has_ended() && seen == job.revision {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    // An id this job has not reached is another job's, or made up.
    let seen = if seen > job.revision { 0 } else { seen };
    let keep_alive = KeepAlive::new().interval(Duration::from_secs(10));
    let mut response = Sse::new(follow(state, caller, id, seen, job)).keep_alive(keep_alive).into_response();
    response.headers_mut().insert(UNBUFFERED.0.clone(), UNBUFFERED.1.clone());
    Ok(response)
}

fn follow(
    state: AppState,
    caller: Caller,
    id: String,
    seen: i64,
    job: Job,
) -> impl Stream<Item = Result<Event, Infallible>> {
    let first = (state, caller, id, seen, Some(Arc::new(job)));
    stream::unfold(first, |(state, caller, id, mut seen, mut known)| async move {
        loop {
            // None: its last event was told.
            let job = known?;
            if job.revision > seen {
                let over = job.status.has_ended();
                let events = if over { ending(&job, seen) } else { progress(&job, job.revision).into_iter().collect() };
                seen = job.revision;
                return Some((stream::iter(events), (state, caller, id, seen, Some(job).filter(|_| !over))));
            }
            // The job was deleted from under us, or the service drains: the client reconnects.
            known = tokio::select! {
                changed = state.workshop.changed_since(&caller.tenant, &id, seen) => changed,
                () = state.workshop.drained() => None,
            };
        }
    })
    .flatten()
    .map(Ok)
}

/// The end: where the client has seen no progress at all, that comes first.
fn ending(job: &Job, seen: i64) -> Vec<Event> {
    let last_progress = progress(job, job.revision - 1).filter(|_| seen < job.revision - 1);
    let status = Event::default().event("status").id(job.revision.to_string()).json_data(JobBody::from(job.clone()));
    last_progress.into_iter().chain(status.ok()).collect()
}

fn progress(job: &Job, id: i64) -> Option<Event> {
    Event::default().event("progress").id(id.to_string()).json_data(&job.progress).ok()
}
