//! Counts requests, by route: the innermost layer that every routed request passes.

use std::time::Instant;

use axum::extract::{MatchedPath, Request, State};
use axum::middleware::Next;
use axum::response::Response;

use crate::http::shared::AppState;

pub async fn counted(State(state): State<AppState>, path: MatchedPath, request: Request, next: Next) -> Response {
    let (method, began) = (request.method().clone(), Instant::now());
    let response = next.run(request).await;
    state.workshop.metrics.answered(method.as_str(), path.as_str(), response.status().as_u16(), began.elapsed());
    response
}
