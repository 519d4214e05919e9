//! Deciding which map a place has.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};

use super::record::{PlaceBody, PublishBody, Rollback, guard, is_name, precondition_failed, tagged};
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller};
use crate::jobs::Fault;
use crate::store::{Guard, Publication};

const LONGEST_NOTE: usize = 1024;

/// Publish a map at a place, as its next version.
#[utoipa::path(put, operation_id = "publish_map", path = "/v1/places/{name}", tag = "places", security(("key" = ["admin"])),
    params(("name" = String, Path, pattern = "^[a-z0-9][a-z0-9._-]{0,62}$"),
        ("If-Match" = Option<String>, Header, description = "publish only where the place is as this ETag says; 412 otherwise"),
        ("If-None-Match" = Option<String>, Header, description = "*: only where there is no such place yet")),
    request_body(content = PublishBody),
    responses((status = 200, description = "the place", body = PlaceBody), (status = 201, description = "the new place", body = PlaceBody),
        Refused))]
pub async fn publish_map(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    Params::of(&uri).finish()?;
    let wanted: PublishBody = state.read_small(&headers, body).await?;
    if !is_name(&name) {
        let detail = "a place's name is a letter a-z or a digit, then up to 62 of those, '.', '_' and '-'";
        return Err(Problem::unprocessable(detail));
    }
    if wanted.map_id.is_empty() {
        return Err(fault("/map_id", "must be a map's id"));
    }
    if wanted.note.as_ref().is_some_and(|note| note.chars().count() > LONGEST_NOTE || note.contains('\0')) {
        return Err(fault("/note", &format!("must have {LONGEST_NOTE} characters at most, and no U+0000")));
    }
    publish(&state, &caller, &name, (&wanted.map_id, wanted.note.as_deref()), &guard(&headers), "/map_id").await
}

/// Publish an older map of a place again, as a new version.
#[utoipa::path(post, operation_id = "roll_back_place", path = "/v1/places/{name}/rollback", tag = "places",
    security(("key" = ["admin"])),
    params(("name" = String, Path), ("If-Match" = Option<String>, Header, description = "only where the place is as this ETag says")),
    request_body(content = Rollback),
    responses((status = 200, description = "the place", body = PlaceBody), Refused))]
pub async fn roll_back_place(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    Params::of(&uri).finish()?;
    let Rollback { version } = state.read_small(&headers, body).await?;
    let records = &state.workshop.records;
    if records.place(&caller.tenant, &name).await?.is_none() {
        return Err(Problem::not_found(format!("there is no place {name}")));
    }
    let Some(older) = records.place_version(&caller.tenant, &name, version).await? else {
        return Err(fault("/version", &format!("the place {name} has no version {version}")));
    };
    let note = format!("rolled back to version {version}");
    let condition = match guard(&headers) {
        Guard::Nothing => Guard::Existing,
        given => given,
    };
    publish(&state, &caller, &name, (&older.map_id, Some(&note)), &condition, "/version").await
}

/// Remove a place and its history. Its maps stay.
#[utoipa::path(delete, operation_id = "remove_place", path = "/v1/places/{name}", tag = "places", security(("key" = ["admin"])),
    params(("name" = String, Path), ("If-Match" = Option<String>, Header, description = "only where the place is as this ETag says")),
    responses((status = 204, description = "removed"), Refused))]
pub async fn remove_place(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<StatusCode, Problem> {
    Params::of(&uri).finish()?;
    match state.workshop.records.remove_place(&caller.tenant, &name, &guard(&headers)).await? {
        Some(true) => Ok(StatusCode::NO_CONTENT),
        Some(false) => Err(Problem::not_found(format!("there is no place {name}"))),
        None => Err(precondition_failed(&name)),
    }
}

async fn publish(
    state: &AppState,
    caller: &Caller,
    name: &str,
    (map_id, note): (&str, Option<&str>),
    guard: &Guard,
    pointer: &str,
) -> Result<Response, Problem> {
    match state.workshop.records.publish(&caller.tenant, name, map_id, note, guard).await? {
        Publication::Published(place) => {
            state.workshop.published.notify_waiters();
            state.workshop.hooks.notify_one();
            let status = if place.version == 1 { StatusCode::CREATED } else { StatusCode::OK };
            let mut response = tagged(place);
            *response.status_mut() = status;
            Ok(response.into_response())
        }
        Publication::Refused => Err(precondition_failed(name)),
        Publication::NoMap => Err(fault(pointer, &format!("there is no map {map_id}"))),
    }
}

fn fault(pointer: &str, detail: &str) -> Problem {
    Problem::invalid(vec![Fault { pointer: pointer.into(), detail: detail.into() }])
}
