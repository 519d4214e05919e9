//! Health, documentation, and the console.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::json;

use super::AppState;
use super::guard::policy;
use super::openapi::document;
use super::problem::Problem;

/// The machine-readable contract.
#[utoipa::path(get, operation_id = "get_openapi", path = "/openapi.json", tag = "service", responses((status = 200, description = "it answers", body = Object)))]
pub async fn openapi() -> Response {
    match document().to_pretty_json() {
        Ok(text) => ([(header::CONTENT_TYPE, "application/json")], text).into_response(),
        Err(error) => {
            tracing::error!(%error, "the OpenAPI document could not be written");
            Problem::of_status(StatusCode::INTERNAL_SERVER_ERROR).into_response()
        }
    }
}

/// Whether the process answers.
#[utoipa::path(get, operation_id = "get_livez", path = "/livez", tag = "service", responses((status = 200, description = "it answers", body = Object)))]
pub async fn livez() -> impl IntoResponse {
    Json(json!({"status": "ok"}))
}

/// Whether it can take work: the database answers, and no shutdown is under way.
#[utoipa::path(get, operation_id = "get_readyz", path = "/readyz", tag = "service",
    responses((status = 200, description = "it takes work", body = Object), (status = 503, description = "it does not, and why", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn readyz(State(state): State<AppState>) -> Result<Response, Problem> {
    if state.workshop.is_draining() {
        let detail = "the service is shutting down".into();
        return Err(Problem { detail, ..Problem::of_status(StatusCode::SERVICE_UNAVAILABLE) });
    }
    state.workshop.records.ping().await?;
    Ok(Json(json!({"status": "ready"})).into_response())
}

/// The console: jobs and maps in a browser.
pub async fn console() -> impl IntoResponse {
    const PAGE: &str = include_str!("../../console/index.html");
    let content = HeaderValue::from_static("text/html; charset=utf-8");
    ([(header::CONTENT_TYPE, content), (header::CONTENT_SECURITY_POLICY, policy(PAGE))], PAGE)
}
