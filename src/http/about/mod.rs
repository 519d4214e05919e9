//! Health, the machine-readable contract, metrics, usage, and the console.

pub mod console;
pub mod metrics;
pub mod usage;

use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::shared::AppState;
use crate::http::shared::problem::{Problem, Refused};

/// Health in one word.
#[derive(Debug, Serialize, ToSchema)]
pub struct Health {
    status: &'static str,
}

/// The machine-readable contract.
#[utoipa::path(get, operation_id = "get_openapi", path = "/openapi.json", tag = "service",
    responses((status = 200, description = "an OpenAPI 3.1 document", body = Object)))]
pub async fn get_openapi(State(state): State<AppState>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], state.document.clone()).into_response()
}

/// Whether the process answers.
#[utoipa::path(get, operation_id = "get_livez", path = "/livez", tag = "service",
    responses((status = 200, description = "it answers", body = Health)))]
pub async fn get_livez() -> Json<Health> {
    Json(Health { status: "ok" })
}

/// Whether it can take work: a row and an artifact were just written, and no shutdown is under way.
#[utoipa::path(get, operation_id = "get_readyz", path = "/readyz", tag = "service",
    responses((status = 200, description = "it takes work", body = Health), Refused))]
pub async fn get_readyz(State(state): State<AppState>) -> Result<Json<Health>, Problem> {
    let unready = |detail: String| Problem { detail, ..Problem::of_status(StatusCode::SERVICE_UNAVAILABLE) };
    if state.workshop.is_draining() {
        return Err(unready("the service is shutting down".into()));
    }
    match state.workshop.takes_work().await {
        Ok(()) => Ok(Json(Health { status: "ready" })),
        Err(why) => Err(unready(why)),
    }
}
