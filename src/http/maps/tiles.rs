//! Square pieces of a layer, for viewers.

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use axum::response::Response;

use super::request::{KINDS, MapRequest, Settled};
use crate::http::shared::AppState;
use crate::http::shared::compute::{Leash, Queue};
use crate::http::shared::negotiate::{Binary, PNG};
use crate::http::shared::problem::{Problem, Refused};
use crate::render::{FINEST, Tile, TileLayer, tile};

const LAYERS: [(&str, TileLayer); 4] = [
    ("distance", TileLayer::Distance),
    ("sigma", TileLayer::Sigma),
    ("clearance", TileLayer::Clearance),
    ("occupancy", TileLayer::Occupancy),
];
/// Where scales end unless told otherwise, metres.
const MOST: f64 = 2.0;
const MOST_SIGMA: f64 = 0.05;

/// Which tile a path names.
pub struct Place {
    layer: TileLayer,
    level: u32,
    x: i32,
    y: i32,
}

impl FromRequestParts<AppState> for Place {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &AppState) -> Result<Self, Problem> {
        let path = Path::<(String, String, String, String, String)>::from_request_parts(parts, state).await;
        let none = || Problem::not_found(format!("there is no such tile; levels are 0 to {FINEST}"));
        let Path((_, layer, level, x, y)) = path.map_err(|_| none())?;
        let layer = LAYERS.iter().find(|(name, _)| *name == layer).map(|(_, layer)| *layer).ok_or_else(none)?;
        let level = level.parse().ok().filter(|level| *level <= FINEST).ok_or_else(none)?;
        Ok(Self { layer, level, x: x.parse().map_err(|_| none())?, y: y.parse().map_err(|_| none())? })
    }
}

/// A square piece of a layer, 256 x 256 pixels, transparent where nothing was observed.
///
/// It covers `[x S, (x+1) S] x [y S, (y+1) S]` of the map's frame, `S = 1024 m / 2^z`, y upwards.
#[utoipa::path(get, operation_id = "get_map_tile", path = "/v1/maps/{id}/tiles/{layer}/{z}/{x}/{y}", tag = "maps",
    security(("key" = ["read"])),
    params(("id" = String, Path), ("layer" = String, Path, pattern = "^(distance|sigma|clearance|occupancy)$"),
        ("z" = u32, Path, maximum = 14), ("x" = i32, Path), ("y" = i32, Path),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "propagated (default) or posterior"),
        ("theme" = Option<String>, Query, pattern = "^(light|dark)$", description = "light (default) or dark"),
        ("max" = Option<f64>, Query, minimum = 0.0001, maximum = 10000, description = "where the scale of colours ends, metres: 2, of sigma 0.05"),
        ("format" = Option<String>, Query, pattern = "^(png)$", description = "png")),
    responses((status = 200, description = "the tile", content((Binary = "image/png"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_tile(place: Place, mut request: MapRequest) -> Result<Response, Problem> {
    let params = &mut request.params;
    let kind = params.choice("kind", &KINDS);
    let dark = params.choice("theme", &[("light", false), ("dark", true)]);
    let usual = if place.layer == TileLayer::Sigma { MOST_SIGMA } else { MOST };
    let most = params.number("max", 1e-4, 1e4).unwrap_or(usual);
    let wanted = match request.settle(&[PNG])? {
        Settled::Unchanged(response) => return Ok(response),
        Settled::Wanted(wanted) => wanted,
    };
    let Place { layer, level, x, y } = place;
    let piece = Tile { layer, level, x, y, kind, dark, most };
    let (turn, map) = wanted.state.turn_with(Queue::Answers, &wanted.record).await?;
    let draw = move |leash: &Leash| Ok(tile(&map, &piece, &|| leash.holds())?);
    let body = turn.run(draw).await?;
    wanted.respond(body)
}
