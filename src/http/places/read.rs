//! Which map a place has: asked once, waited for, listed, followed.

use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Redirect, Response};

use super::record::{PlaceBody, tag, tagged, tags};
use crate::http::shared::page::Page;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused};
use crate::http::shared::{AppState, Caller};
use crate::store::Place;

/// List places, published last first.
#[utoipa::path(get, operation_id = "list_places", path = "/v1/places", tag = "places", security(("key" = ["read"])),
    params(("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query)),
    responses((status = 200, description = "a page of places", body = Page<PlaceBody>), Refused))]
pub async fn list_places(State(state): State<AppState>, caller: Caller, uri: Uri) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let (limit, before) = params.numbered_page();
    params.finish()?;
    let places = state.workshop.records.places(&caller.tenant, before, limit + 1).await?;
    state.page(Page::<PlaceBody>::numbered(places, limit, |place: &Place| place.serial)).await
}

/// Which map a place has; with `wait` and `If-None-Match`, answers when that has changed, or 304 after so many seconds.
#[utoipa::path(get, operation_id = "get_place", path = "/v1/places/{name}", tag = "places", security(("key" = ["read"])),
    params(("name" = String, Path), ("wait" = Option<f64>, Query, minimum = 0, maximum = 60, description = "seconds"),
        ("If-None-Match" = Option<String>, Header, description = "the ETag of the place as it is known")),
    responses((status = 200, description = "the place", body = PlaceBody, headers(("etag" = String, description = "of this publication"))),
        (status = 304, description = "unchanged"), Refused))]
pub async fn get_place(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let wait = params.number("wait", 0.0, 60.0).unwrap_or(0.0);
    params.finish()?;
    let known: Vec<String> =
        tags(&headers, header::IF_NONE_MATCH).iter().map(|tag| tag.trim_start_matches("W/").to_owned()).collect();
    let over = tokio::time::sleep(Duration::from_secs_f64(wait));
    tokio::pin!(over);
    loop {
        let place = named(&state, &caller, &name).await?;
        if !known.iter().any(|known| *known == tag(&place) || known == "*") {
            return Ok(tagged(place));
        }
        let changed = tokio::select! {
            changed = state.workshop.republished_since(&caller.tenant, &name, place.serial) => changed,
            () = &mut over => false,
            () = state.workshop.drained() => false,
        };
        if !changed {
            let mut unchanged = tagged(place);
            *unchanged.status_mut() = StatusCode::NOT_MODIFIED;
            *unchanged.body_mut() = axum::body::Body::empty();
            unchanged.headers_mut().remove(header::CONTENT_TYPE);
            unchanged.headers_mut().remove(header::CONTENT_LENGTH);
            return Ok(unchanged);
        }
    }
}

/// Every version that a place had, newest first.
#[utoipa::path(get, operation_id = "list_place_versions", path = "/v1/places/{name}/versions", tag = "places",
    security(("key" = ["read"])),
    params(("name" = String, Path), ("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query)),
    responses((status = 200, description = "a page of versions", body = Page<PlaceBody>), Refused))]
pub async fn list_place_versions(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    uri: Uri,
) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let (limit, before) = params.numbered_page();
    params.finish()?;
    named(&state, &caller, &name).await?;
    let versions = state.workshop.records.place_versions(&caller.tenant, &name, before, limit + 1).await?;
    state.page(Page::<PlaceBody>::numbered(versions, limit, |place: &Place| place.version)).await
}

/// To the published map.
#[utoipa::path(get, operation_id = "get_place_map", path = "/v1/places/{name}/map", tag = "places", security(("key" = ["read"])),
    params(("name" = String, Path)),
    responses((status = 307, description = "to the published map", headers(("location" = String, description = "its address"))), Refused))]
pub async fn get_place_map(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    uri: Uri,
) -> Result<Response, Problem> {
    redirect(&state, &caller, &name, "", &uri).await
}

/// To the same path of the published map.
#[utoipa::path(get, operation_id = "get_place_map_part", path = "/v1/places/{name}/map/{part}", tag = "places",
    security(("key" = ["read"])),
    params(("name" = String, Path), ("part" = String, Path, description = "what of the map, as below `/v1/maps/{id}/`")),
    responses((status = 307, description = "to that part of the published map", headers(("location" = String, description = "its address"))),
        Refused))]
pub async fn get_place_map_part(
    State(state): State<AppState>,
    caller: Caller,
    Path((name, part)): Path<(String, String)>,
    uri: Uri,
) -> Result<Response, Problem> {
    redirect(&state, &caller, &name, &below(&part), &uri).await
}

/// To the same tile of the published map.
#[utoipa::path(get, operation_id = "get_place_map_tile", path = "/v1/places/{name}/map/tiles/{layer}/{z}/{x}/{y}", tag = "places",
    security(("key" = ["read"])),
    params(("name" = String, Path), ("layer" = String, Path), ("z" = String, Path), ("x" = String, Path),
        ("y" = String, Path, description = "all of it as below `/v1/maps/{id}/tiles/`, which says what there is")),
    responses((status = 307, description = "to that tile of the published map", headers(("location" = String, description = "its address"))),
        Refused))]
pub async fn get_place_map_tile(
    State(state): State<AppState>,
    caller: Caller,
    Path((name, layer, z, x, y)): Path<(String, String, String, String, String)>,
    uri: Uri,
) -> Result<Response, Problem> {
    let part: String = ["tiles", &layer, &z, &x, &y].map(below).concat();
    redirect(&state, &caller, &name, &part, &uri).await
}

/// Ask the published map: the same question, to the same path of the map.
#[utoipa::path(post, operation_id = "ask_place_map", path = "/v1/places/{name}/map/{part}", tag = "places",
    security(("key" = ["read"])),
    params(("name" = String, Path), ("part" = String, Path, description = "`query` or `localize`")),
    responses((status = 307, description = "to that part of the published map", headers(("location" = String, description = "its address"))),
        Refused))]
pub async fn ask_place_map(
    State(state): State<AppState>,
    caller: Caller,
    Path((name, part)): Path<(String, String)>,
    uri: Uri,
) -> Result<Response, Problem> {
    redirect(&state, &caller, &name, &below(&part), &uri).await
}

/// A path's part, as an address has it.
fn below(part: &str) -> String {
    format!("/{}", form_urlencoded::byte_serialize(part.as_bytes()).collect::<String>().replace('+', "%20"))
}

async fn redirect(state: &AppState, caller: &Caller, name: &str, part: &str, uri: &Uri) -> Result<Response, Problem> {
    let place = named(state, caller, name).await?;
    let query = uri.query().map(|query| format!("?{query}")).unwrap_or_default();
    let to = format!("/v1/maps/{}{part}{query}", place.map_id);
    Ok(([(header::CACHE_CONTROL, "private, no-cache")], Redirect::temporary(&to)).into_response())
}

async fn named(state: &AppState, caller: &Caller, name: &str) -> Result<Place, Problem> {
    let place = state.workshop.records.place(&caller.tenant, name).await?;
    place.ok_or_else(|| Problem::not_found(format!("there is no place {name}")))
}
