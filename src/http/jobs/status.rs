//! What became of a job: its state, lists, its request, cancellation.

use std::time::Duration;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};

use super::record::JobBody;
use super::schema::AcceptedRequestBody;
use crate::http::shared::compute::Queue;
use crate::http::shared::kept::unpack;
use crate::http::shared::page::Page;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller, Scope};
use crate::jobs::{Job, JobStatus, Stored};
use crate::store::{Cancellation, Listing, Removal};

/// List jobs, newest first.
#[utoipa::path(get, operation_id = "list_jobs", path = "/v1/jobs", tag = "jobs", security(("key" = ["read"])),
    params(
        ("status" = Option<JobStatus>, Query, description = "jobs in this state alone"),
        ("label" = Option<Vec<String>>, Query, explode, max_items = 16, description = "key:value; may be repeated, all must match"),
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query),
    ),
    responses((status = 200, description = "a page of jobs", body = Page<JobBody>), Refused))]
pub async fn list_jobs(State(state): State<AppState>, caller: Caller, uri: Uri) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let (limit, before) = params.page();
    let labels = params.labels();
    let status = params.text("status").map(|name| JobStatus::from_name(name).ok_or(()));
    if status == Some(Err(())) {
        let names: Vec<&str> = JobStatus::ALL.iter().map(|status| status.name()).collect();
        params.fault("status", format!("must be one of {}", names.join(", ")));
    }
    params.finish()?;
    let status = status.and_then(Result::ok);
    let listing = Listing { tenant: caller.tenant.to_string(), status, labels, bbox: None, before, limit: limit + 1 };
    let jobs = state.workshop.records.jobs(&listing).await?;
    state.page(Page::<JobBody>::of(jobs, limit, |job: &Job| &job.id)).await
}

/// A job's state; with `wait`, answers when the job has ended or after that many seconds.
#[utoipa::path(get, operation_id = "get_job", path = "/v1/jobs/{id}", tag = "jobs", security(("key" = ["read"])),
    params(("id" = String, Path), ("wait" = Option<f64>, Query, minimum = 0, maximum = 60, description = "seconds")),
    responses((status = 200, description = "the job", body = JobBody), Refused))]
pub async fn get_job(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<Json<JobBody>, Problem> {
    let mut params = Params::of(&uri);
    let wait = params.number("wait", 0.0, 60.0).unwrap_or(0.0);
    params.finish()?;
    let mut job = state.job(&caller, &id).await?;
    if wait > 0.0 && !job.status.has_ended() {
        let deadline = tokio::time::sleep(Duration::from_secs_f64(wait));
        tokio::pin!(deadline);
        while !job.status.has_ended() {
            let changed = tokio::select! {
                changed = state.workshop.changed_since(&caller.tenant, &id, job.revision) => changed,
                () = &mut deadline => None,
                () = state.workshop.drained() => None,
            };
            match changed {
                Some(changed) => job = Job::clone(&changed),
                // Gone, perhaps, or as it is now.
                None => return Ok(Json(state.job(&caller, &id).await?.into())),
            }
        }
    }
    Ok(Json(job.into()))
}

/// The accepted request, whole, as its client sent it: of an update the new scans.
#[utoipa::path(get, operation_id = "get_job_request", path = "/v1/jobs/{id}/request", tag = "jobs", security(("key" = ["read"])), params(("id" = String, Path)),
    responses((status = 200, description = "the request as it was accepted", body = AcceptedRequestBody), Refused))]
pub async fn get_job_request(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<Response, Problem> {
    Params::of(&uri).finish()?;
    // Nobody waits for his turn to hear that there is no such job.
    let _ = state.job(&caller, &id).await?;
    let turn = state.compute.turn(Queue::Requests).await?;
    let compressed = state.workshop.records.request(&caller.tenant, &id).await?;
    let compressed = compressed.ok_or_else(|| Problem::not_found(format!("there is no job {id}")))?;
    let (compressed, bytes) = turn.measured(compressed, u64::MAX).await?;
    let held = state.may_unpack(&turn, bytes).await?;
    let unpack = move |_: &_| {
        let _held = held;
        let stored = unpack(&compressed)?;
        let stored = Stored::read(&stored).map_err(|error| Problem::internal(&error))?;
        Ok(stored.body().to_vec())
    };
    let json = turn.run(unpack).await?;
    let body = state.answers.take(json.len())?.body(json);
    Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
}

/// Cancel a job that has not ended; a running fit stops within one step.
///
/// With `purge=true`, removes a job that has ended, and its request, where its map is deleted or it has none.
#[utoipa::path(delete, operation_id = "cancel_job", path = "/v1/jobs/{id}", tag = "jobs", security(("key" = ["submit"])),
    params(("id" = String, Path),
        ("purge" = Option<bool>, Query, description = "true: remove an ended job, and its request")),
    responses((status = 200, body = JobBody, description = "dismissed"),
        (status = 204, description = "removed"),
        (status = 409, body = crate::http::shared::problem::ProblemBody, content_type = "application/problem+json",
            description = "it has ended; or, to be removed, it has not, or its map is still there"),
        Refused))]
pub async fn cancel_job(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let purge = params.choice("purge", &[("false", false), ("true", true)]);
    params.finish()?;
    if purge {
        caller.needs(Scope::Admin)?;
        return remove(&state, &caller, &id).await;
    }
    match state.workshop.records.cancel(&caller.tenant, &id).await? {
        Cancellation::Dismissed(job) => {
            state.workshop.stop(&id);
            Ok(Json(JobBody::from(job)).into_response())
        }
        Cancellation::AlreadyEnded(job) => {
            let detail = format!("the job is {} already", job.status.name());
            Err(Problem::new(StatusCode::CONFLICT, "job-has-ended", "The job has ended", detail))
        }
        Cancellation::Unknown => Err(Problem::not_found(format!("there is no job {id}"))),
    }
}

async fn remove(state: &AppState, caller: &Caller, id: &str) -> Result<Response, Problem> {
    let conflict = |slug, title, detail: String| Problem::new(StatusCode::CONFLICT, slug, title, detail);
    match state.workshop.records.remove_job(&caller.tenant, id).await? {
        Removal::Removed => Ok(StatusCode::NO_CONTENT.into_response()),
        Removal::NotEnded => Err(conflict("job-has-not-ended", "The job has not ended", "cancel it first".into())),
        Removal::HasMap(map) => {
            let detail =
                format!("its map {map} is still there, and is formed from the job's request; delete that first");
            Err(conflict("job-has-a-map", "The job has a map", detail))
        }
        Removal::Unknown => Err(Problem::not_found(format!("there is no job {id}"))),
    }
}
