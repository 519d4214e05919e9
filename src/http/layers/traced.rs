//! A span for every request that changes something, and for others that bring a `traceparent`: inside what keys guard, so
//! that strangers make none. Reading is most of a fleet's traffic, and would crowd out what happens to jobs.

use axum::extract::{MatchedPath, Request, State};
use axum::http::HeaderMap;
use axum::middleware::Next;
use axum::response::Response;
use opentelemetry::Context;
use opentelemetry::context::FutureExt;
use opentelemetry::trace::SpanKind;

use super::conventions::RequestId;
use crate::http::shared::AppState;
use crate::traces::context_of;

pub async fn traced(State(state): State<AppState>, path: MatchedPath, request: Request, next: Next) -> Response {
    let (traces, came) = (&state.workshop.traces, came_with(request.headers()));
    if came.is_none() && (request.method().is_safe() || !traces.are_kept()) {
        return next.run(request).await;
    }
    let name = format!("{} {}", request.method(), path.as_str());
    let span = traces.begin(name, SpanKind::Server, &came.unwrap_or_default(), None);
    span.set("http.request.method", request.method().to_string());
    span.set("http.route", path.as_str().to_owned());
    span.set("url.path", request.uri().path().to_owned());
    if let Some(RequestId(id)) = request.extensions().get() {
        span.set("mapfit.request.id", id.clone());
    }
    let response = next.run(request).with_context(span.context().clone()).await;
    span.set("http.response.status_code", i64::from(response.status().as_u16()));
    if response.status().is_server_error() {
        span.fail(response.status().to_string());
    }
    response
}

/// The span that a client made this request under. Two are none.
fn came_with(headers: &HeaderMap) -> Option<Context> {
    let mut all = headers.get_all("traceparent").iter();
    let one = all.next().filter(|_| all.next().is_none())?;
    context_of(one.to_str().ok()?)
}
