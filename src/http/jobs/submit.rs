//! Submission: the body is received, validated off the threads that answer, and durable before the answer goes out.

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use opentelemetry::Context;
use opentelemetry::trace::SpanKind;
use serde::Serialize;
use utoipa::ToSchema;

use super::document::Document;
use super::dry_run::DryRun;
use super::record::JobBody;
use super::recording;
use super::schema::{JobRequestBody, RecordingBody};
use crate::http::shared::body::Received;
use crate::http::shared::compute::{Leash, Queue};
use crate::http::shared::multipart;
use crate::http::shared::negotiate::{JSON, MULTIPART};
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::standing::Standing;
use crate::http::shared::{AppState, Caller};
use crate::jobs::{Fault, JobRequest, Limits};
use crate::store::{NewJob, Quota, Submission};

/// A job that was there already, or what one would be.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
#[allow(dead_code)]
pub enum Submitted {
    Job(Box<JobBody>),
    DryRun(DryRun),
}

/// Submit a job.
///
/// The job is durable before the answer is sent. With `Idempotency-Key`, a repeat of the same body returns the first
/// job. With `dry_run=true` nothing is kept: the answer says what the map would be and cost.
#[utoipa::path(post, operation_id = "submit_job", path = "/v1/jobs", tag = "jobs", security(("key" = ["submit"])),
    params(("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255,
        description = "makes a repeat of the same body return the first job"),
        ("dry_run" = Option<bool>, Query, description = "true: say what the map would be and cost, and keep nothing")),
    request_body(content((JobRequestBody = "application/json"), (RecordingBody = "multipart/form-data")),
        description = "scans, their noise, and the map to fit; or a recording that has the scans, with all else as its options. May be gzip or zstd"),
    responses(
        (status = 202, body = JobBody, description = "accepted", headers(("location" = String, description = "the job's address"))),
        (status = 200, body = Submitted, description = "this key and body were accepted before; or, of a dry run, what it would be"),
        Refused,
    ))]
pub async fn submit_job(
    State(state): State<AppState>,
    caller: Caller,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let dry_run = params.choice("dry_run", &[("false", false), ("true", true)]);
    let ((), body) = state.before(params.finish(), body)?;
    let received = state.read_body(&headers, body, &[JSON.media, MULTIPART]).await?;
    let reading = Reading {
        boundary: (received.media == MULTIPART).then(|| multipart::boundary(&headers)).transpose()?,
        limits: state.workshop.limits,
        largest: state.limits.body,
    };
    let key = idempotency_key(&headers)?;
    if dry_run {
        let try_out = move |leash: &Leash| {
            let request = JobRequest::parse(&reading.document(received, leash)?.json, &reading.limits)?;
            let run = DryRun::of(&request, &|| leash.holds()).ok_or_else(Problem::too_slow)?;
            Ok(if reading.boundary.is_some() { run.showing(&request) } else { run })
        };
        return Ok(Json(state.compute.run(Queue::Answers, try_out).await?).into_response());
    }
    let (quota, budget) = (state.limits.quota, state.workshop.rules.memory);
    let queue = if reading.boundary.is_some() { Queue::Requests } else { received.queue() };
    let prepare =
        move |leash: &Leash| prepare(reading.document(received, leash)?, key, &reading.limits, (budget, leash));
    let new = state.compute.run(queue, prepare).await?;
    accept(&state, NewJob { tenant: caller.tenant.to_string(), quota: Some(quota), ..new }).await
}

/// How a body is to be read: as it is, or as a form with this boundary.
struct Reading {
    boundary: Option<String>,
    limits: Limits,
    /// Bytes a body may have.
    largest: usize,
}

impl Reading {
    /// For the threads that compute.
    fn document(&self, received: Received, leash: &Leash) -> Result<Document, Problem> {
        let body = received.unpack()?;
        match &self.boundary {
            Some(boundary) => recording::document(body, boundary, &self.limits, self.largest, leash),
            None => Ok(Document::of(body)),
        }
    }
}

/// Submits, and answers with the job. Its attempts' spans are under this one, which is under the request's.
pub async fn accept(state: &AppState, new: NewJob) -> Result<Response, Problem> {
    let span = state.workshop.traces.begin("submit", SpanKind::Producer, &Context::current(), None);
    let quota = new.quota;
    let new = NewJob { traceparent: span.traceparent(), ..new };
    let (status, job) = match state.workshop.records.submit(new).await? {
        Submission::Accepted(job) => {
            tracing::info!(job = %job.id, tenant = job.tenant, "accepted");
            (StatusCode::ACCEPTED, job)
        }
        Submission::Repeated(job) => (StatusCode::OK, job),
        Submission::KeyReused => {
            let detail = "this Idempotency-Key was used with another body";
            let fault = Fault { pointer: String::new(), detail: detail.into() };
            return Err(Problem { slug: "idempotency-key-reused", ..Problem::invalid(vec![fault]) });
        }
        Submission::OverQuota(what) => return Err(over_quota(what, quota)),
    };
    state.workshop.arrivals.notify_one();
    span.set("mapfit.job.id", job.id.clone());
    let location = format!("/v1/jobs/{}", job.id);
    let mut response = (status, Json(JobBody::from(job))).into_response();
    if let Ok(location) = HeaderValue::from_str(&location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

/// Seconds after which jobs may have ended.
const QUOTA_AGAIN: u32 = 30;

fn over_quota(what: &'static str, quota: Option<Quota>) -> Problem {
    let detail = format!("the tenant has as many {what} as it may; see /v1/usage");
    let standing = quota.map(|Quota { queued, bytes }| {
        let most = if what == "queued jobs" { queued } else { bytes };
        Box::new(Standing { policy: what, quota: most.unsigned_abs(), window: None, left: 0, reset: QUOTA_AGAIN })
    });
    let problem = Problem::new(StatusCode::TOO_MANY_REQUESTS, "over-quota", "Over quota", detail);
    Problem { retry_after: Some(QUOTA_AGAIN), standing, ..problem }
}

pub fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    match value.to_str() {
        Ok(key) if (1..=255).contains(&key.len()) => Ok(Some(key.to_owned())),
        _ => Err(Problem {
            detail: "Idempotency-Key must have 1 to 255 ASCII characters".into(),
            ..Problem::of_status(StatusCode::BAD_REQUEST)
        }),
    }
}

fn prepare(
    document: Document,
    key: Option<String>,
    limits: &Limits,
    (budget, leash): (u64, &Leash),
) -> Result<NewJob, Problem> {
    let Document { json, digest, message } = document;
    let request = JobRequest::parse(&json, limits)?;
    within_memory(&request, budget, ("/map/resolution", "a coarser resolution or smaller bounds need less"), leash)?;
    Ok(NewJob { message, ..new_job(request, &json, key.map(|key| (key, digest)))? })
}

/// Refuses a fit that needs more memory than there is. `fault` is where the request says so, and what helps.
pub fn within_memory(
    request: &JobRequest,
    budget: u64,
    (pointer, advice): (&str, &str),
    leash: &Leash,
) -> Result<(), Problem> {
    let Some(bytes) = request.outgrows(budget, &|| leash.holds()) else { return Ok(()) };
    let need = bytes / f64::from(1 << 20);
    let detail = format!(
        "the fit needs about {need:.0} MiB of memory, and the service may use {} MiB (--memory); {advice}",
        budget >> 20
    );
    Err(Problem::invalid(vec![Fault { pointer: pointer.into(), detail }]))
}

/// A job of nobody's yet. `stored` is what is kept of its request, `idempotency` the client's key and a digest.
pub fn new_job(request: JobRequest, stored: &[u8], idempotency: Option<(String, String)>) -> Result<NewJob, Problem> {
    let progress = request.queued();
    Ok(NewJob {
        tenant: String::new(),
        name: request.name,
        labels: request.labels,
        priority: request.priority,
        progress,
        message: None,
        request: zstd::bulk::compress(stored, 1).map_err(|error| Problem::internal(&error))?,
        idempotency,
        retry_of: None,
        deadline_seconds: request.deadline_seconds,
        traceparent: None,
        quota: None,
    })
}
