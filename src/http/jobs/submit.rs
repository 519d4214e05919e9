//! Submission: the body is received, validated off the threads that answer, and durable before the answer goes out.

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};

use super::record::JobBody;
use super::schema::JobRequestBody;
use crate::http::shared::AppState;
use crate::http::shared::compute::Queue;
use crate::http::shared::negotiate::JSON;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::state::TENANT;
use crate::jobs::{Fault, JobRequest, Limits, Progress, RequestError};
use crate::store::{NewJob, Submission};

/// Submit a job.
///
/// The job is durable before the answer is sent. With `Idempotency-Key`, a repeat of the same body returns the first
/// job.
#[utoipa::path(post, operation_id = "submit_job", path = "/v1/jobs", tag = "jobs",
    params(("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255,
        description = "makes a repeat of the same body return the first job")),
    request_body(content = JobRequestBody, description = "scans, their noise, and the map to fit; may be gzip or zstd"),
    responses(
        (status = 202, body = JobBody, description = "accepted", headers(("location" = String, description = "the job's address"))),
        (status = 200, body = JobBody, description = "this key and body were accepted before", headers(("location" = String, description = "the job's address"))),
        Refused,
    ))]
pub async fn submit_job(State(state): State<AppState>, headers: HeaderMap, body: Body) -> Result<Response, Problem> {
    let received = state.read_body(&headers, body, &[JSON.media]).await?;
    let key = idempotency_key(&headers)?;
    let limits = state.workshop.limits;
    let new = state.compute.run(Queue::Requests, move |_| prepare(&received.unpack()?, key, &limits)).await?;
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

fn prepare(json: &[u8], key: Option<String>, limits: &Limits) -> Result<NewJob, Problem> {
    let request = JobRequest::parse(json, limits).map_err(|error| match error {
        RequestError::Document(error) => error.into(),
        RequestError::Faults(faults) => Problem::invalid(faults),
    })?;
    let body: String = Sha256::digest(json).iter().map(|byte| format!("{byte:02x}")).collect();
    let compressed = zstd::encode_all(json, 1).map_err(|error| Problem::internal(&error))?;
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
