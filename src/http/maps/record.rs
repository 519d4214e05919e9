//! Maps' records: lists, one, deletion.

use std::collections::BTreeMap;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::request::{MapRequest, Settled};
use crate::fit::Distance;
use crate::http::shared::negotiate::JSON;
use crate::http::shared::page::{Page, timestamp};
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::http::shared::relabel::{RelabelBody, relabelling};
use crate::http::shared::{AppState, Caller};
use crate::jobs::MapRecord;
use crate::map::FitReport;
use crate::spline::Lattice;
use crate::store::{Listing, MapRemoval};

/// The frame every map of this version is in.
pub const FRAME: &str = "map";

/// A map, as clients see it.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Map)]
pub struct MapBody {
    #[schema(format = "uuid")]
    pub id: String,
    #[schema(format = "uuid")]
    pub job_id: String,
    #[schema(required)]
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    #[schema(format = "date-time", required)]
    pub created: Option<String>,
    pub distance: Distance,
    pub frame_id: &'static str,
    pub lattice: LatticeBody,
    pub fit: FitReport,
    /// The map that this one grew from; null of a first fit.
    #[schema(required)]
    pub parent: Option<String>,
    /// 1 for a first fit.
    pub version: i64,
    /// Addresses by relation.
    pub links: BTreeMap<&'static str, String>,
}

impl From<MapRecord> for MapBody {
    fn from(map: MapRecord) -> Self {
        let itself = format!("/v1/maps/{}", map.id);
        let mut links: BTreeMap<&'static str, String> = [
            "changes",
            "coefficients",
            "covariance",
            "contours",
            "frames",
            "grid",
            "image",
            "mcap",
            "ogm",
            "poses",
            "query",
            "surfaces",
            "tiles",
            "updates",
        ]
        .map(|part| (part, format!("{itself}/{part}")))
        .into();
        links.insert("self", itself);
        links.insert("job", format!("/v1/jobs/{}", map.job_id));
        Self {
            id: map.id,
            job_id: map.job_id,
            name: map.name,
            labels: map.labels,
            created: timestamp(map.created),
            distance: map.distance,
            frame_id: FRAME,
            lattice: LatticeBody::of(&map.lattice),
            fit: map.fit,
            parent: map.parent,
            version: map.version,
            links,
        }
    }
}

/// A lattice of control points; cell (i, j) of it has the control points (i..i+3, j..j+3).
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Lattice)]
pub struct LatticeBody {
    /// Its lower left corner, metres.
    pub origin: [f64; 2],
    /// The spacing, metres.
    pub resolution: f64,
    /// Along x and y.
    pub cells: [usize; 2],
    pub control_points: [usize; 2],
}

impl LatticeBody {
    pub fn of(lattice: &Lattice) -> Self {
        Self {
            origin: lattice.origin,
            resolution: lattice.resolution,
            cells: lattice.cells,
            control_points: lattice.control_points(),
        }
    }
}

/// List maps, newest first.
#[utoipa::path(get, operation_id = "list_maps", path = "/v1/maps", tag = "maps", security(("key" = ["read"])),
    params(
        ("label" = Option<Vec<String>>, Query, explode, max_items = 16, description = "key:value; may be repeated, all must match"),
        ("bbox" = Option<String>, Query, description = "minx,miny,maxx,maxy; maps that touch it"),
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query),
    ),
    responses((status = 200, description = "a page of maps", body = Page<MapBody>),
        Refused))]
pub async fn list_maps(State(state): State<AppState>, caller: Caller, uri: Uri) -> Result<Response, Problem> {
    let mut params = Params::of(&uri);
    let (limit, before) = params.page();
    let labels = params.labels();
    let bbox = params.text("bbox").map(parse_bbox);
    if bbox == Some(None) {
        params.fault("bbox", "must be minx,miny,maxx,maxy with min no greater than max");
    }
    params.finish()?;
    let listing = Listing {
        tenant: caller.tenant.to_string(),
        status: None,
        labels,
        bbox: bbox.flatten(),
        before,
        limit: limit + 1,
    };
    let maps = state.workshop.records.maps(&listing).await?;
    state.page(Page::<MapBody>::of(maps, limit, |map: &MapRecord| &map.id)).await
}

fn parse_bbox(text: &str) -> Option<[f64; 4]> {
    let numbers: Vec<f64> = text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<_>>()?;
    let bbox: [f64; 4] = numbers.try_into().ok()?;
    (bbox.iter().all(|v| v.is_finite()) && bbox[0] <= bbox[2] && bbox[1] <= bbox[3]).then_some(bbox)
}

/// A map's record.
#[utoipa::path(get, operation_id = "get_map", path = "/v1/maps/{id}", tag = "maps", security(("key" = ["read"])), params(("id" = String, Path)),
    responses((status = 200, description = "the map", body = MapBody), (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map(mut request: MapRequest) -> Result<Response, Problem> {
    let MapRecord { name, labels, .. } = &request.record;
    request.version = format!("{name:?} {labels:?}");
    match request.settle(&[JSON])? {
        Settled::Unchanged(response) => Ok(response),
        Settled::Wanted(wanted) => {
            let body = to_json(&MapBody::from(wanted.record.clone()))?;
            wanted.respond(body)
        }
    }
}

/// Give a map another name or other labels.
#[utoipa::path(patch, operation_id = "relabel_map", path = "/v1/maps/{id}", tag = "maps", security(("key" = ["submit"])),
    params(("id" = String, Path)), request_body(content = RelabelBody),
    responses((status = 200, description = "the map", body = MapBody), Refused))]
pub async fn relabel_map(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<MapBody>, Problem> {
    Params::of(&uri).finish()?;
    let change = relabelling(&state, &headers, body).await?;
    let map = state.workshop.records.relabel_map(&caller.tenant, &id, &change).await?;
    map.map(|map| Json(map.into())).ok_or_else(|| Problem::not_found(format!("there is no map {id}")))
}

/// Delete a map and its arrays. Its job stays.
#[utoipa::path(delete, operation_id = "delete_map", path = "/v1/maps/{id}", tag = "maps", security(("key" = ["admin"])),
    params(("id" = String, Path)),
    responses((status = 204, description = "deleted"),
        (status = 409, body = crate::http::shared::problem::ProblemBody, content_type = "application/problem+json",
            description = "a place has it as one of its versions"),
        Refused))]
pub async fn delete_map(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<Response, Problem> {
    Params::of(&uri).finish()?;
    let record = match state.workshop.records.remove_map(&caller.tenant, &id).await? {
        MapRemoval::Removed(record) => record,
        MapRemoval::Unknown => return Err(Problem::not_found(format!("there is no map {id}"))),
        MapRemoval::Named(place) => {
            let detail = format!("the place {place} has it as one of its versions, and may be rolled back to it");
            return Err(Problem::new(StatusCode::CONFLICT, "map-is-published", "The map is published", detail));
        }
    };
    state.forget(&id);
    // The record is gone, so the map is; arrays that stay behind are swept later.
    if let Err(error) = state.workshop.artifacts.remove(&record.prefix).await {
        tracing::warn!(map = %id, %error, "a deleted map's arrays could not be removed yet");
    }
    Ok(StatusCode::NO_CONTENT.into_response())
}
