//! What differs between a map and another one: polygons, or a picture of them.

use axum::response::Response;

use super::pictures::{DEFAULT_WIDTH, WIDTHS, title};
use super::record::FRAME;
use super::request::{MapRequest, Settled};
use crate::http::shared::compute::{Leash, Queue};
use crate::http::shared::negotiate::{Binary, GEOJSON, JSON, PNG, SVG};
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::jobs::MapRecord;
use crate::living::{MOST_PROBABLE, changes, changes_geojson, changes_picture};
use crate::render::{RenderError, svg_to_png};

const LEAST_PROBABLE: f64 = 0.5;
const DEFAULT_PROBABILITY: f64 = 0.99;

/// What differs from another map beyond what the uncertainty of both explains.
///
/// Both maps' frames are taken as one. What either has not seen is no change. `probability` is that nothing at all is shown
/// where nothing has changed, over the whole map.
#[utoipa::path(get, operation_id = "get_map_changes", path = "/v1/maps/{id}/changes", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path),
        ("since" = String, Query, description = "the other map, by id: the older one"),
        ("probability" = Option<f64>, Query, minimum = 0.5, maximum = 0.999999, description = "0.99 by default"),
        ("width" = Option<u32>, Query, minimum = 200, maximum = 4096, description = "pixels, for svg and png"),
        ("format" = Option<String>, Query, pattern = "^(geojson|json|svg|png)$", description = "geojson, svg or png")),
    responses((status = 200, description = "polygons with `properties` role (`appeared`: surface where there was free space; \
            `vanished`: free space where there was surface), probability and area, in metres of the maps' frame",
            content((Object = "application/geo+json"), (Object = "application/json"), (String = "image/svg+xml"), (Binary = "image/png"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_changes(mut request: MapRequest) -> Result<Response, Problem> {
    let probability = request.params.number("probability", LEAST_PROBABLE, MOST_PROBABLE);
    let probability = probability.unwrap_or(DEFAULT_PROBABILITY);
    let width = request.params.number("width", WIDTHS.0, WIDTHS.1).unwrap_or(DEFAULT_WIDTH);
    let since = since(&mut request).await?;
    let wanted = match request.settle(&[GEOJSON, JSON, SVG, PNG])? {
        Settled::Unchanged(response) => return Ok(response),
        Settled::Wanted(wanted) => wanted,
    };
    // Without one, settling has refused.
    let since = since.ok_or_else(|| Problem::not_found("there is no such map"))?;
    let (turn, new) = wanted.state.turn_with(Queue::Answers, &wanted.record).await?;
    let old = wanted.state.load(&turn, &since).await?;
    let (record, format) = (wanted.record.clone(), wanted.format);
    let make = move |leash: &Leash| {
        let found = changes(&new, &old, probability).map_err(RenderError::from)?;
        leash.goes_on()?;
        let picture = || changes_picture(&new, &found, width, &title(&record, &format!("since {}", since.id)));
        match format {
            SVG => Ok(picture()?.into_bytes()),
            PNG => Ok(svg_to_png(&picture()?)?),
            _ => to_json(&changes_geojson(&found, FRAME)),
        }
    };
    let body = turn.run(make).await?;
    wanted.respond(body)
}

/// The map that `since` names; that there is none is a fault of the parameter.
async fn since(request: &mut MapRequest) -> Result<Option<MapRecord>, Problem> {
    let Some(id) = request.params.text("since").map(str::to_owned) else {
        request.params.fault("since", "is required: the map to compare with");
        return Ok(None);
    };
    let record = request.state.workshop.records.map(&request.caller.tenant, &id).await?;
    if record.is_none() {
        request.params.fault("since", format!("there is no map {id}"));
    }
    Ok(record)
}
