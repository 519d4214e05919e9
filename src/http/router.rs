//! The one file that knows all routes, and what stands around them.
//!
//! A route is registered with its description (`routes!`), so what is served is what the document says.

use std::sync::Arc;

use axum::Router;
use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::IntoResponse;
use axum::routing::get;
use tower_http::CompressionLevel;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use utoipa::OpenApi;
use utoipa::openapi::security::{Http, HttpAuthScheme, SecurityScheme};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use utoipa_swagger_ui::{Config, SwaggerUi};

use super::about::{self, console, metrics, usage};
use super::jobs::{change, events, join, status, submit, update};
use super::layers::compression::Texts;
use super::layers::{conventions, counted, guard, keys, traced};
use super::maps::{arrays, changes, covariance, frames, localize, pictures, query, record, tiles};
use super::places::{publish, read};
use super::shared::problem::Problem;
use super::shared::state::HttpLimits;
use super::shared::{AppState, Service};
use super::webhooks;
use crate::worker::Workshop;

#[derive(OpenApi)]
#[openapi(
    info(title = "mapfit", description = "Distance maps with their covariance, from laser scans."),
    tags(
        (name = "jobs", description = "Scans in: submission, states, cancellation"),
        (name = "maps", description = "Maps out: coefficients, covariance, queries, pictures"),
        (name = "places", description = "Names under which maps follow one another"),
        (name = "webhooks", description = "Being told of what happens"),
        (name = "service", description = "Health and documentation"),
    )
)]
struct Contract;

/// Every route that the document describes.
fn described() -> OpenApiRouter<AppState> {
    OpenApiRouter::with_openapi(Contract::openapi())
        .routes(routes!(submit::submit_job, status::list_jobs))
        .routes(routes!(status::get_job, status::cancel_job, change::relabel_job))
        .routes(routes!(change::retry_job))
        .routes(routes!(events::get_job_events))
        .routes(routes!(status::get_job_request))
        .routes(routes!(record::list_maps))
        .routes(routes!(join::join_maps))
        .routes(routes!(update::update_map))
        .routes(routes!(frames::get_map_frames))
        .routes(routes!(record::get_map, record::delete_map, record::relabel_map))
        .routes(routes!(arrays::get_map_coefficients))
        .routes(routes!(arrays::get_map_surfaces))
        .routes(routes!(arrays::get_map_poses))
        .routes(routes!(covariance::get_map_covariance))
        .routes(routes!(query::query_map))
        .routes(routes!(localize::localize_scans))
        .routes(routes!(changes::get_map_changes))
        .routes(routes!(pictures::get_map_contours))
        .routes(routes!(pictures::get_map_ogm))
        .routes(routes!(pictures::get_map_grid))
        .routes(routes!(pictures::get_map_mcap))
        .routes(routes!(pictures::get_map_image))
        .routes(routes!(tiles::get_map_tile))
        .routes(routes!(read::list_places))
        .routes(routes!(read::get_place, publish::publish_map, publish::remove_place))
        .routes(routes!(read::list_place_versions))
        .routes(routes!(publish::roll_back_place))
        .routes(routes!(read::get_place_map))
        .routes(routes!(read::get_place_map_part, read::ask_place_map))
        .routes(routes!(read::get_place_map_tile))
        .routes(routes!(webhooks::add_webhook, webhooks::list_webhooks))
        .routes(routes!(webhooks::get_webhook, webhooks::remove_webhook))
        .routes(routes!(webhooks::list_deliveries))
        .routes(routes!(usage::get_usage))
        .routes(routes!(about::get_openapi))
        .routes(routes!(about::get_livez))
        .routes(routes!(about::get_readyz))
        .routes(routes!(metrics::get_metrics))
}

/// The OpenAPI document, as `openapi/openapi.json` has it.
pub fn document() -> String {
    // A document is plain data: writing it as JSON cannot fail.
    let mut document = described().into_openapi();
    let key = Http::builder().scheme(HttpAuthScheme::Bearer).bearer_format("mapfit_ID_SECRET");
    let key = key.description(Some("an API key, where the service has any: `mapfit keys create`"));
    let components = document.components.get_or_insert_default();
    components.add_security_scheme("key", SecurityScheme::Http(key.build()));
    document.to_pretty_json().unwrap_or_default() + "\n"
}

/// What the service answers on its address, and on that for metrics where they have one of their own.
pub struct Faces {
    pub public: Router,
    pub metrics: Option<Router>,
}

/// The service.
pub fn router(workshop: Arc<Workshop>, limits: HttpLimits, metrics_apart: bool) -> Faces {
    let state: AppState = Arc::new(Service::new(workshop, limits, document()));
    let metrics = metrics_apart.then(|| apart(state.clone()));
    Faces { public: public(state, metrics_apart), metrics }
}

/// What a process answers that works and does not serve: how it is.
pub fn router_of_worker(workshop: Arc<Workshop>) -> Router {
    apart(Arc::new(Service::new(workshop, HttpLimits::default(), document())))
}

/// Metrics and health on an address of their own: for those who look after the service, without keys.
fn apart(state: AppState) -> Router {
    Router::new()
        .route("/metrics", get(metrics::get_metrics))
        .route("/livez", get(about::get_livez))
        .route("/readyz", get(about::get_readyz))
        .with_state(state)
}

fn public(state: AppState, metrics_apart: bool) -> Router {
    let docs = SwaggerUi::new("/docs").config(Config::from("/openapi.json").validator_url("none"));
    let (routes, _) = described().split_for_parts();
    routes
        .route_layer(from_fn_with_state(state.clone(), traced::traced))
        .route_layer(from_fn_with_state(state.clone(), keys::let_in))
        .route_layer(from_fn_with_state(state.clone(), counted::counted))
        .route("/", get(console::page))
        .route("/assets/{name}", get(console::asset))
        .route("/licenses.md", get(console::licenses))
        .with_state(state.clone())
        .merge(docs)
        .fallback(|| async { Problem::not_found("no such resource") })
        .method_not_allowed_fallback(|| async { Problem::of_status(StatusCode::METHOD_NOT_ALLOWED) })
        .layer(from_fn(move |request: Request, next: Next| async move {
            // Not below `/v1`, so no key guards it: where it has an address of its own, it is there alone.
            match metrics_apart && request.uri().path() == "/metrics" {
                true => Problem::not_found("metrics are on another address").into_response(),
                false => next.run(request).await,
            }
        }))
        .layer(CatchPanicLayer::custom(conventions::after_panic))
        .layer(from_fn_with_state(state, guard::loopback_only))
        .layer(from_fn(guard::secured))
        .layer(CompressionLayer::new().quality(CompressionLevel::Fastest).compress_when(Texts))
        .layer(from_fn(conventions::finish))
}
