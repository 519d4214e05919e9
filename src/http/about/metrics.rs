//! What the process counts of itself.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use crate::http::shared::AppState;
use crate::http::shared::problem::{Problem, Refused};

/// Prometheus' text format, version 0.0.4.
const MEDIA: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Counters and durations, for Prometheus.
#[utoipa::path(get, operation_id = "get_metrics", path = "/metrics", tag = "service",
    responses((status = 200, description = "Prometheus' text format", body = String, content_type = "text/plain"), Refused))]
pub async fn get_metrics(State(state): State<AppState>) -> Result<Response, Problem> {
    // Where the database is away, what the process knows by itself is worth more than nothing.
    let totals = state.workshop.records.totals().await.ok();
    let text = state.workshop.metrics.text(totals).map_err(|error| Problem::internal(&error))?;
    Ok(([(header::CONTENT_TYPE, MEDIA)], text).into_response())
}
