//! What may be done with a job beside cancelling it: other labels, and another try.

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::Response;

use super::record::JobBody;
use super::submit::accept;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::relabel::{RelabelBody, relabelling};
use crate::http::shared::{AppState, Caller};
use crate::store::NewJob;

/// Give a job another name or other labels. A map that it has already keeps its own.
#[utoipa::path(patch, operation_id = "relabel_job", path = "/v1/jobs/{id}", tag = "jobs", security(("key" = ["submit"])),
    params(("id" = String, Path)), request_body(content = RelabelBody),
    responses((status = 200, description = "the job", body = JobBody), Refused))]
pub async fn relabel_job(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<JobBody>, Problem> {
    Params::of(&uri).finish()?;
    let change = relabelling(&state, &headers, body).await?;
    let job = state.workshop.records.relabel_job(&caller.tenant, &id, &change).await?;
    job.map(|job| Json(job.into())).ok_or_else(|| Problem::not_found(format!("there is no job {id}")))
}

/// Submit an ended job's request once more, as a new job with the same name, labels and priority.
#[utoipa::path(post, operation_id = "retry_job", path = "/v1/jobs/{id}/retry", tag = "jobs", security(("key" = ["submit"])),
    params(("id" = String, Path)),
    responses((status = 202, description = "the new job, `retry_of` the old one", body = JobBody,
            headers(("location" = String, description = "the job's address"))),
        (status = 409, body = crate::http::shared::problem::ProblemBody, content_type = "application/problem+json",
            description = "it has not ended"),
        Refused))]
pub async fn retry_job(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<Response, Problem> {
    Params::of(&uri).finish()?;
    let job = state.job(&caller, &id).await?;
    if !job.status.has_ended() {
        let detail = format!("the job is {}; it can be tried again once it has ended", job.status.name());
        return Err(Problem::new(StatusCode::CONFLICT, "job-has-not-ended", "The job has not ended", detail));
    }
    let request = state.workshop.records.request(&caller.tenant, &id).await?;
    let request = request.ok_or_else(|| Problem::not_found(format!("there is no job {id}")))?;
    let span = |until: i64| (until - job.created) as f64 / 1000.0;
    let new = NewJob {
        tenant: job.tenant,
        name: job.name,
        labels: job.labels,
        priority: job.priority,
        progress: job.progress.again(),
        message: None,
        request,
        idempotency: None,
        retry_of: Some(job.id),
        deadline_seconds: job.deadline.map(span),
        traceparent: None,
        quota: Some(state.limits.quota),
    };
    accept(&state, new).await
}
