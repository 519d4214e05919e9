//! The HTTP service: the contract's routes over the store and the maps.
//!
//! | file | what it answers |
//! | --- | --- |
//! | [`jobs`], [`events`] | submission, states, cancellation, long poll, server-sent events |
//! | [`maps`], [`covariance`], [`query`], [`pictures`] | a map's record, arrays, points, pictures |
//! | [`service`] | health, documentation, the console |
//! | [`conventions`], [`guard`], [`problem`], [`params`], [`negotiate`], [`body`], [`caching`], [`representation`] | what all routes share |
//!
//! Domain errors know nothing of HTTP; they become problems here, at the border.

pub mod body;
pub mod caching;
pub mod conventions;
pub mod covariance;
pub mod events;
pub mod guard;
pub mod jobs;
pub mod maps;
pub mod negotiate;
pub mod openapi;
pub mod params;
pub mod pictures;
pub mod problem;
pub mod query;
pub mod representation;
pub mod service;

use std::sync::Arc;

use axum::Router;
use axum::middleware::from_fn;
use axum::routing::{get, post};
use tower_http::catch_panic::CatchPanicLayer;
use utoipa_swagger_ui::{Config, SwaggerUi};

use crate::worker::Workshop;
use caching::MapCache;
use problem::Problem;

/// What every handler shares.
pub struct Service {
    pub workshop: Arc<Workshop>,
    pub maps: MapCache,
    /// Bytes a request body may have after decompression.
    pub body_limit: usize,
}

pub type AppState = Arc<Service>;

/// The tenant of requests without a key; with API keys each key will bring its own.
pub(crate) const TENANT: &str = "default";
/// The default limit of a request's body: 64 MiB.
pub const BODY_LIMIT: usize = 64 << 20;

/// Every route of the service.
pub fn router(workshop: Arc<Workshop>) -> Router {
    let state: AppState = Arc::new(Service { workshop, maps: MapCache::default(), body_limit: BODY_LIMIT });
    let docs = SwaggerUi::new("/docs").config(Config::from("/openapi.json").validator_url("none"));
    Router::new()
        .route("/v1/jobs", post(jobs::submit).get(jobs::list))
        .route("/v1/jobs/{id}", get(jobs::get).delete(jobs::cancel))
        .route("/v1/jobs/{id}/events", get(events::events))
        .route("/v1/jobs/{id}/request", get(jobs::request))
        .route("/v1/maps", get(maps::list))
        .route("/v1/maps/{id}", get(maps::get).delete(maps::delete))
        .route("/v1/maps/{id}/coefficients", get(maps::coefficients))
        .route("/v1/maps/{id}/poses", get(maps::poses))
        .route("/v1/maps/{id}/covariance", get(covariance::covariance))
        .route("/v1/maps/{id}/query", post(query::query))
        .route("/v1/maps/{id}/contours", get(pictures::contours))
        .route("/v1/maps/{id}/ogm", get(pictures::ogm))
        .route("/v1/maps/{id}/grid", get(pictures::grid))
        .route("/v1/maps/{id}/image", get(pictures::image))
        .route("/openapi.json", get(service::openapi))
        .route("/livez", get(service::livez))
        .route("/readyz", get(service::readyz))
        .route("/", get(service::console))
        .merge(docs)
        .fallback(|| async { Problem::not_found("no such resource") })
        .method_not_allowed_fallback(|| async { Problem::of_status(axum::http::StatusCode::METHOD_NOT_ALLOWED) })
        .with_state(state)
        .layer(CatchPanicLayer::custom(conventions::after_panic))
        .layer(from_fn(guard::loopback_only))
        .layer(from_fn(guard::secured))
        .layer(from_fn(conventions::finish))
}
