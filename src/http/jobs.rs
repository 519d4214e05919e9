//! Jobs: submission, states, lists, long poll, cancellation.

use std::collections::BTreeMap;
use std::time::Duration;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use sha2::{Digest, Sha256};
use utoipa::ToSchema;

use super::caching::Queue;
use super::negotiate::JSON;
use super::params::{Params, to_cursor};
use super::problem::Problem;
use super::{AppState, TENANT};
use crate::jobs::{Fault, Job, JobRequest, JobStatus, ProblemReport, Progress, RequestError};
use crate::store::{Cancellation, Listing, NewJob, Submission};

/// A job, as clients see it.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Job)]
pub struct JobBody {
    #[schema(format = "uuid")]
    pub id: String,
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    pub status: JobStatus,
    pub progress: Progress,
    pub message: Option<String>,
    #[schema(format = "date-time")]
    pub created: Option<String>,
    #[schema(format = "date-time")]
    pub started: Option<String>,
    #[schema(format = "date-time")]
    pub finished: Option<String>,
    #[schema(format = "date-time")]
    pub updated: Option<String>,
    /// How often the job was begun.
    pub attempt: i64,
    pub priority: i32,
    /// Set once successful.
    pub map_id: Option<String>,
    /// Set once failed.
    pub problem: Option<ProblemReport>,
    /// Addresses by relation: self, events, request, and map once there is one.
    pub links: BTreeMap<&'static str, String>,
}

impl From<Job> for JobBody {
    fn from(job: Job) -> Self {
        let own = format!("/v1/jobs/{}", job.id);
        let mut links = BTreeMap::from([("events", format!("{own}/events")), ("request", format!("{own}/request"))]);
        links.insert("self", own);
        if let Some(map_id) = &job.map_id {
            links.insert("map", format!("/v1/maps/{map_id}"));
        }
        Self {
            id: job.id,
            name: job.name,
            labels: job.labels,
            status: job.status,
            progress: job.progress,
            message: job.message,
            created: timestamp(job.created),
            started: job.started.and_then(timestamp),
            finished: job.finished.and_then(timestamp),
            updated: timestamp(job.updated),
            attempt: job.attempt,
            priority: job.priority,
            map_id: job.map_id,
            problem: job.problem,
            links,
        }
    }
}

/// RFC 3339 in UTC, to the millisecond.
pub(crate) fn timestamp(milliseconds: i64) -> Option<String> {
    jiff::Timestamp::from_millisecond(milliseconds).ok().map(|time| format!("{time:.3}"))
}

/// One page of a list.
#[derive(Debug, Serialize, ToSchema)]
pub struct Page<T: ToSchema> {
    pub items: Vec<T>,
    /// For `?cursor=`; null on the last page.
    pub next_cursor: Option<String>,
}

/// A page from one item more than it shows, which tells whether another follows.
pub(crate) fn page<S, T: ToSchema + From<S>>(mut rows: Vec<S>, limit: i64, id: impl Fn(&S) -> &str) -> Page<T> {
    let more = rows.len() as i64 > limit;
    rows.truncate(limit as usize);
    let next_cursor = rows.last().filter(|_| more).map(|last| to_cursor(id(last)));
    Page { items: rows.into_iter().map(T::from).collect(), next_cursor }
}

/// Submit a job.
///
/// The job is durable before the answer is sent. With `Idempotency-Key`, a repeat of the same body returns the first
/// job.
#[utoipa::path(post, operation_id = "submit_job", path = "/v1/jobs", tag = "jobs",
    params(("Idempotency-Key" = Option<String>, Header, description = "makes a repeat of the same body return the first job")),
    request_body(content = super::openapi::JobRequestBody, description = "scans, their noise, and the map to fit; may be gzip or zstd"),
    responses(
        (status = 202, body = JobBody, description = "accepted", headers(("location" = String))),
        (status = 200, body = JobBody, description = "this key and body were accepted before"),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json"),
    ))]
pub async fn submit(State(state): State<AppState>, headers: HeaderMap, body: Body) -> Result<Response, Problem> {
    let received = state.read_body(&headers, body, &[JSON.media]).await?;
    let key = idempotency_key(&headers)?;
    let limits = state.workshop.limits;
    let new = state.compute(Queue::Requests, move || prepare(&received.unpack()?, key, &limits)).await?;
    let (status, job) = match state.workshop.records.submit(new).await? {
        Submission::Accepted(job) => (StatusCode::ACCEPTED, job),
        Submission::Repeated(job) => (StatusCode::OK, job),
        Submission::KeyReused => {
            let detail = "this Idempotency-Key was used with another body";
            let fault = Fault { pointer: String::new(), detail: detail.into() };
            return Err(Problem { slug: "idempotency-key-reused", ..Problem::invalid(vec![fault]) });
        }
    };
    state.workshop.arrivals.notify_one();
    let location = format!("/v1/jobs/{}", job.id);
    let mut response = (status, Json(JobBody::from(job))).into_response();
    if let Ok(location) = HeaderValue::from_str(&location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    match value.to_str() {
        Ok(key) if (1..=255).contains(&key.len()) => Ok(Some(key.to_owned())),
        _ => Err(Problem {
            detail: "Idempotency-Key must have 1 to 255 ASCII characters".into(),
            ..Problem::of_status(StatusCode::BAD_REQUEST)
        }),
    }
}

fn prepare(json: &[u8], key: Option<String>, limits: &crate::jobs::Limits) -> Result<NewJob, Problem> {
    let request = JobRequest::parse(json, limits).map_err(|error| match error {
        RequestError::Document(error) => error.into(),
        RequestError::Faults(faults) => Problem::invalid(faults),
    })?;
    let body: String = Sha256::digest(json).iter().map(|byte| format!("{byte:02x}")).collect();
    let compressed = zstd::encode_all(json, 1).map_err(|error| {
        tracing::error!(%error, "a request could not be compressed");
        Problem::of_status(StatusCode::INTERNAL_SERVER_ERROR)
    })?;
    Ok(NewJob {
        tenant: TENANT.into(),
        name: request.name,
        labels: request.labels,
        priority: request.priority,
        progress: Progress::queued(request.options.max_iterations),
        message: None,
        request: compressed,
        idempotency: key.map(|key| (key, body)),
    })
}

/// List jobs, newest first.
#[utoipa::path(get, operation_id = "list_jobs", path = "/v1/jobs", tag = "jobs",
    params(
        ("status" = Option<JobStatus>, Query, description = "jobs in this state alone"),
        ("label" = Option<String>, Query, description = "key:value; may be repeated, all must match"),
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query),
    ),
    responses((status = 200, description = "a page of jobs", body = Page<JobBody>),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn list(State(state): State<AppState>, uri: Uri) -> Result<Json<Page<JobBody>>, Problem> {
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
    let listing = Listing { tenant: TENANT.into(), status, labels, bbox: None, before, limit: limit + 1 };
    let jobs = state.workshop.records.jobs(&listing).await?;
    Ok(Json(page(jobs, limit, |job: &Job| &job.id)))
}

/// A job's state; with `wait`, answers when the job has ended or after that many seconds.
#[utoipa::path(get, operation_id = "get_job", path = "/v1/jobs/{id}", tag = "jobs",
    params(("id" = String, Path), ("wait" = Option<f64>, Query, minimum = 0, maximum = 60, description = "seconds")),
    responses((status = 200, description = "the job", body = JobBody),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn get(State(state): State<AppState>, Path(id): Path<String>, uri: Uri) -> Result<Json<JobBody>, Problem> {
    let mut params = Params::of(&uri);
    let wait = params.number("wait", 0.0, 60.0).unwrap_or(0.0);
    params.finish()?;
    let deadline = tokio::time::Instant::now() + Duration::from_secs_f64(wait);
    loop {
        let job = find(&state, &id).await?;
        let now = tokio::time::Instant::now();
        if job.status.has_ended() || now >= deadline || state.workshop.is_draining() {
            return Ok(Json(job.into()));
        }
        tokio::time::sleep_until(deadline.min(now + super::events::POLL)).await;
    }
}

pub(crate) async fn find(state: &AppState, id: &str) -> Result<Job, Problem> {
    let job = state.workshop.records.job(TENANT, id).await?;
    job.ok_or_else(|| Problem::not_found(format!("there is no job {id}")))
}

/// The accepted request, whole.
#[utoipa::path(get, operation_id = "get_job_request", path = "/v1/jobs/{id}/request", tag = "jobs", params(("id" = String, Path)),
    responses((status = 200, description = "the request as it was accepted", body = super::openapi::JobRequestBody),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn request(State(state): State<AppState>, Path(id): Path<String>) -> Result<Response, Problem> {
    let compressed = state.workshop.records.request(TENANT, &id).await?;
    let compressed = compressed.ok_or_else(|| Problem::not_found(format!("there is no job {id}")))?;
    let json = state
        .compute(Queue::Requests, move || {
            zstd::decode_all(&compressed[..]).map_err(|error| {
                tracing::error!(%error, "a stored request is damaged");
                Problem::of_status(StatusCode::INTERNAL_SERVER_ERROR)
            })
        })
        .await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], json).into_response())
}

/// Cancel a job that has not ended; a running fit stops within one step.
#[utoipa::path(delete, operation_id = "cancel_job", path = "/v1/jobs/{id}", tag = "jobs", params(("id" = String, Path)),
    responses((status = 200, body = JobBody, description = "dismissed"),
        (status = 409, body = super::openapi::ProblemBody, content_type = "application/problem+json", description = "it has ended"),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn cancel(State(state): State<AppState>, Path(id): Path<String>) -> Result<Json<JobBody>, Problem> {
    match state.workshop.records.cancel(TENANT, &id).await? {
        Cancellation::Dismissed(job) => {
            state.workshop.stop(&id);
            Ok(Json(job.into()))
        }
        Cancellation::AlreadyEnded(job) => {
            let detail = format!("the job is {} already", job.status.name());
            Err(Problem::new(StatusCode::CONFLICT, "job-has-ended", "The job has ended", detail))
        }
        Cancellation::Unknown => Err(Problem::not_found(format!("there is no job {id}"))),
    }
}
