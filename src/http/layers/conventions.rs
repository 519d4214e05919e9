//! What holds for every response: a request id, and problems for every error, whoever raised it.
//!
//! Whatever is logged while a request is answered has its id, by a span of the log around it; an answer that is the
//! service's own fault is always logged, for its id is all that a client can tell of it.

use std::any::Any;

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tracing::Instrument;
use uuid::Uuid;

use crate::http::shared::problem::Problem;

static REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
const PROBLEM_JSON: HeaderValue = HeaderValue::from_static("application/problem+json");

/// What a request is known by, within.
#[derive(Debug, Clone)]
pub struct RequestId(pub String);

/// The outermost layer: gives the request its id, and errors their bodies.
pub async fn finish(mut request: Request, next: Next) -> Response {
    let id = request
        .headers()
        .get(&REQUEST_ID)
        .and_then(|id| id.to_str().ok())
        .filter(|id| !id.is_empty() && id.len() <= 128 && id.bytes().all(|b| b.is_ascii_graphic()))
        .map_or_else(|| Uuid::now_v7().to_string(), str::to_owned);
    request.extensions_mut().insert(RequestId(id.clone()));
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let began = std::time::Instant::now();
    // Of the highest level, so that it is there whichever level is logged.
    let span = tracing::error_span!("request", request_id = id);
    let mut response = next.run(request).instrument(span.clone()).await;
    let (status, ms) = (response.status(), began.elapsed().as_millis() as u64);
    let problem = response.extensions_mut().remove::<Problem>().or_else(|| {
        // Raised by the framework or a layer, in its own words.
        (status.is_client_error() || status.is_server_error()).then(|| Problem::of_status(status))
    });
    if let Some(problem) = &problem {
        write_problem(&mut response, problem, &path, &id);
    }
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(&REQUEST_ID, value);
    }
    span.in_scope(|| match &problem {
        // Refused for load or what is away: whoever comes in bulk must not bury what failed.
        Some(Problem { slug, detail, .. }) if status == StatusCode::SERVICE_UNAVAILABLE => {
            tracing::warn!(%method, path, status = status.as_u16(), ms, problem = slug, detail, "a request failed");
        }
        Some(Problem { slug, detail, .. }) if status.is_server_error() => {
            tracing::error!(%method, path, status = status.as_u16(), ms, problem = slug, detail, "a request failed");
        }
        _ => tracing::debug!(%method, path, status = status.as_u16(), ms, "answered"),
    });
    response
}

fn write_problem(response: &mut Response, problem: &Problem, path: &str, id: &str) {
    let body = serde_json::to_vec(&problem.body(path, id)).unwrap_or_default();
    response.headers_mut().insert(header::CONTENT_TYPE, PROBLEM_JSON);
    response.headers_mut().insert(header::CONTENT_LENGTH, HeaderValue::from(body.len()));
    *response.body_mut() = Body::from(body);
}

/// What a handler's panic becomes; the panic's own words stay in the log.
pub fn after_panic(panic: Box<dyn Any + Send + 'static>) -> Response {
    let text = panic.downcast_ref::<String>().cloned();
    let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
    tracing::error!(panic = text.unwrap_or_default(), "a handler panicked");
    Problem::of_status(StatusCode::INTERNAL_SERVER_ERROR).into_response()
}
