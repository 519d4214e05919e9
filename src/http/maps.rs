//! Maps: their records, coefficients and poses.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::{Value, json};
use utoipa::ToSchema;

use super::jobs::{Page, page, timestamp};
use super::negotiate::{JSON, NPZ};
use super::openapi::{FitBody, LatticeBody};
use super::params::Params;
use super::problem::Problem;
use super::representation::{MapRequest, Settled};
use super::{AppState, TENANT};
use crate::fit::Distance;
use crate::geometry::{Cov3, Pose};
use crate::jobs::MapRecord;
use crate::map::FittedMap;
use crate::map::npz::NpzError;
use crate::map::on_lattice_npz;
use crate::spline::Lattice;
use crate::store::Listing;

/// The frame every map of this version is in.
pub(crate) const FRAME: &str = "map";

/// A map, as clients see it.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Map)]
pub struct MapBody {
    #[schema(format = "uuid")]
    pub id: String,
    pub job_id: String,
    pub name: Option<String>,
    pub labels: BTreeMap<String, String>,
    #[schema(format = "date-time")]
    pub created: Option<String>,
    /// `sdf` or `vdf`
    #[schema(value_type = String)]
    pub distance: Distance,
    pub frame_id: &'static str,
    #[schema(value_type = LatticeBody)]
    pub lattice: Value,
    #[schema(value_type = FitBody)]
    pub fit: crate::map::FitReport,
    /// Addresses by relation.
    pub links: BTreeMap<&'static str, String>,
}

impl From<MapRecord> for MapBody {
    fn from(map: MapRecord) -> Self {
        let own = format!("/v1/maps/{}", map.id);
        let mut links: BTreeMap<&'static str, String> =
            ["coefficients", "covariance", "contours", "grid", "image", "ogm", "poses", "query"]
                .map(|part| (part, format!("{own}/{part}")))
                .into();
        links.insert("self", own);
        links.insert("job", format!("/v1/jobs/{}", map.job_id));
        Self {
            id: map.id,
            job_id: map.job_id,
            name: map.name,
            labels: map.labels,
            created: timestamp(map.created),
            distance: map.distance,
            frame_id: FRAME,
            lattice: lattice_json(&map.lattice),
            fit: map.fit,
            links,
        }
    }
}

/// When a map was made.
pub(crate) fn timestamp_of(record: &MapRecord) -> Option<String> {
    timestamp(record.created)
}

/// A lattice as the contract has it.
pub fn lattice_json(lattice: &Lattice) -> Value {
    json!({
        "origin": lattice.origin,
        "resolution": lattice.resolution,
        "cells": lattice.cells,
        "control_points": lattice.control_points(),
    })
}

/// List maps, newest first.
#[utoipa::path(get, operation_id = "list_maps", path = "/v1/maps", tag = "maps",
    params(
        ("label" = Option<String>, Query, description = "key:value; may be repeated, all must match"),
        ("bbox" = Option<String>, Query, description = "minx,miny,maxx,maxy; maps that touch it"),
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 1000), ("cursor" = Option<String>, Query),
    ),
    responses((status = 200, description = "a page of maps", body = Page<MapBody>),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn list(State(state): State<AppState>, uri: Uri) -> Result<Json<Page<MapBody>>, Problem> {
    let mut params = Params::of(&uri);
    let (limit, before) = params.page();
    let labels = params.labels();
    let bbox = params.text("bbox").map(parse_bbox);
    if bbox == Some(None) {
        params.fault("bbox", "must be minx,miny,maxx,maxy with min no greater than max");
    }
    params.finish()?;
    let listing =
        Listing { tenant: TENANT.into(), status: None, labels, bbox: bbox.flatten(), before, limit: limit + 1 };
    let maps = state.workshop.records.maps(&listing).await?;
    Ok(Json(page(maps, limit, |map: &MapRecord| &map.id)))
}

fn parse_bbox(text: &str) -> Option<[f64; 4]> {
    let numbers: Vec<f64> = text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<_>>()?;
    let bbox: [f64; 4] = numbers.try_into().ok()?;
    (bbox.iter().all(|v| v.is_finite()) && bbox[0] <= bbox[2] && bbox[1] <= bbox[3]).then_some(bbox)
}

/// A map's record.
#[utoipa::path(get, operation_id = "get_map", path = "/v1/maps/{id}", tag = "maps", params(("id" = String, Path)),
    responses((status = 200, description = "the map", body = MapBody), (status = 304, description = "unchanged"),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn get(request: MapRequest) -> Result<Response, Problem> {
    Ok(match request.settle(&[JSON])? {
        Settled::Unchanged(response) => response,
        Settled::Wanted(wanted) => {
            let body = to_json(&MapBody::from(wanted.record.clone()))?;
            wanted.respond(body)
        }
    })
}

/// Delete a map and its arrays. Its job stays.
#[utoipa::path(delete, operation_id = "delete_map", path = "/v1/maps/{id}", tag = "maps", params(("id" = String, Path)),
    responses((status = 204, description = "deleted"),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn delete(State(state): State<AppState>, Path(id): Path<String>) -> Result<Response, Problem> {
    let Some(record) = state.workshop.records.delete_map(TENANT, &id).await? else {
        return Err(Problem::not_found(format!("there is no map {id}")));
    };
    state.forget(&id);
    // The record is gone, so the map is; arrays that stay behind are swept later.
    if let Err(error) = state.workshop.artifacts.remove(&record.prefix).await {
        tracing::warn!(map = %id, %error, "a deleted map's arrays could not be removed yet");
    }
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// A map's coefficients, x fastest.
#[utoipa::path(get, operation_id = "get_map_coefficients", path = "/v1/maps/{id}/coefficients", tag = "maps",
    params(("id" = String, Path), ("format" = Option<String>, Query, description = "json or npz")),
    responses((status = 200, description = "`{lattice, sdf}` or `{lattice, vdf_x, vdf_y}`; or npz with those of shape (ny+3, nx+3), \
            `origin`, `resolution`. Null (NaN) where a control point is not in use",
            content((super::openapi::CoefficientsBody = "application/json"), (Vec<u8> = "application/x-npz"))),
        (status = 304, description = "unchanged"),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn coefficients(request: MapRequest) -> Result<Response, Problem> {
    let make = |map: &FittedMap, _: &MapRecord, format| {
        let (lattice, arrays) = (map.lattice(), map.field.coefficients());
        if format == NPZ {
            return Ok(on_lattice_npz(lattice, &arrays)?);
        }
        let mut body = json!({"lattice": lattice_json(lattice)});
        arrays.into_iter().for_each(|(name, values)| body[name] = json!(values));
        to_json(&body)
    };
    request.answer(&[JSON, NPZ], make).await
}

/// The poses as the fit leaves them: refined with their covariances, or as reported.
#[utoipa::path(get, operation_id = "get_map_poses", path = "/v1/maps/{id}/poses", tag = "maps", params(("id" = String, Path)),
    responses((status = 200, description = "the poses", body = super::openapi::PosesBody), (status = 304, description = "unchanged"),
        (status = "4XX", description = "what is wrong with the request", body = super::openapi::ProblemBody, content_type = "application/problem+json")))]
pub async fn poses(request: MapRequest) -> Result<Response, Problem> {
    let row_major =
        |all: &[Cov3], scan: usize| all.get(scan).map(|c| c.transpose().iter().copied().collect::<Vec<f64>>());
    let make = move |map: &FittedMap, _: &MapRecord, _| {
        let described = |(scan, pose): (usize, &Pose)| {
            json!({
                "pose": pose,
                "covariance": row_major(&map.pose_covariance.propagated, scan),
                "posterior_covariance": row_major(&map.pose_covariance.posterior, scan),
            })
        };
        let poses: Vec<Value> = map.poses.iter().enumerate().map(described).collect();
        to_json(&json!({"poses": poses, "treatment": map.report.weights.poses}))
    };
    request.answer(&[JSON], make).await
}

pub(crate) fn to_json(value: &impl Serialize) -> Result<Vec<u8>, Problem> {
    serde_json::to_vec(value).map_err(|error| {
        tracing::error!(%error, "an answer could not be written");
        Problem::of_status(StatusCode::INTERNAL_SERVER_ERROR)
    })
}

impl From<NpzError> for Problem {
    fn from(error: NpzError) -> Self {
        tracing::error!(%error, "an archive could not be written");
        Self::of_status(StatusCode::INTERNAL_SERVER_ERROR)
    }
}
