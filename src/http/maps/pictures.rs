//! Contours, occupancy grids and pictures of a map.

use axum::response::Response;
use serde_json::{Value, json};

use super::record::FRAME;
use super::request::{KINDS, MapRequest};
use crate::http::shared::compute::Leash;
use crate::http::shared::negotiate::{Binary, GEOJSON, JSON, MCAP, NPZ, PNG, SVG, TIFF, ZIP};
use crate::http::shared::page::timestamp;
use crate::http::shared::params::Params;
use crate::http::shared::problem::{Problem, Refused, to_json};
use crate::jobs::MapRecord;
use crate::map::FittedMap;
use crate::render::{
    Layer, Nav2Mode, OccupancyGrid, Overlay, Page, Picture, RasterLayer, Rasters, Stamp, Theme, contour_picture,
    contours_while as trace, grayscale_png, map_picture_while, svg_to_png, to_geojson, to_mcap, to_nav2_zip,
};
use crate::uncertainty::Kind;

/// Cells of an occupancy grid at most.
const LARGEST_GRID: f64 = 4e6;
/// Levels farther than this are no map's.
const FARTHEST_LEVEL: f64 = 1e6;
/// Pictures are this wide, in pixels.
pub(super) const WIDTHS: (usize, usize) = (200, 4096);
pub(super) const DEFAULT_WIDTH: usize = 900;
/// The page's, by their names.
const THEMES: [(&str, Theme); 2] = [("light", Theme::Light), ("dark", Theme::Dark)];

/// A level line of the distance, and the band it lies in.
#[utoipa::path(get, operation_id = "get_map_contours", path = "/v1/maps/{id}/contours", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path),
        ("level" = Option<f64>, Query, minimum = -1000000, maximum = 1000000, description = "metres; 0 by default: the walls"),
        ("sigma_band" = Option<f64>, Query, minimum = 0.001, maximum = 100, description = "adds the band of that many standard deviations"),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "propagated (default) or posterior"),
        ("width" = Option<u32>, Query, minimum = 200, maximum = 4096, description = "pixels, for svg and png; type, lines and margins grow with it"),
        ("theme" = Option<String>, Query, pattern = "^(light|dark)$", description = "light (default) or dark, for svg and png"),
        ("format" = Option<String>, Query, pattern = "^(geojson|json|svg|png)$", description = "geojson, svg or png")),
    responses((status = 200, description = "features with `properties.role` level and band, in metres of the map's frame",
            content((Object = "application/geo+json"), (Object = "application/json"), (String = "image/svg+xml"), (Binary = "image/png"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_contours(mut request: MapRequest) -> Result<Response, Problem> {
    let params = &mut request.params;
    let level = params.number("level", -FARTHEST_LEVEL, FARTHEST_LEVEL).unwrap_or(0.0);
    let sigma_band = params.number("sigma_band", 1e-3, 100.0);
    let kind = params.choice("kind", &KINDS);
    let page = page(params, kind);
    let make = move |map: &FittedMap, record: &MapRecord, format, leash: &Leash| {
        let traced = trace(map, level, sigma_band, kind, &|| leash.holds())?;
        let what = if level == 0.0 { "contour".to_owned() } else { format!("contour of {level} m") };
        let picture = || contour_picture(map, &traced, &Page { title: title(record, &what), ..page });
        match format {
            SVG => Ok(picture().into_bytes()),
            PNG => Ok(svg_to_png(&picture())?),
            _ => to_json(&to_geojson(&traced, FRAME)),
        }
    };
    request.answer_while(&[GEOJSON, JSON, SVG, PNG], make).await
}

/// The occupancy grid map.
#[utoipa::path(get, operation_id = "get_map_ogm", path = "/v1/maps/{id}/ogm", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path),
        ("resolution" = Option<f64>, Query, minimum = 0.0001, maximum = 10000, description = "metres a cell; the lattice's by default"),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "propagated (default) or posterior"),
        ("format" = Option<String>, Query, pattern = "^(json|png|zip)$", description = "json, png or zip (map.yaml and its image for Nav2)"),
        ("mode" = Option<String>, Query, pattern = "^(trinary|scale|raw)$", description = "how Nav2's map_server reads the zip's image: trinary (default), scale or raw")),
    responses((status = 200, description = "the fields of nav_msgs/OccupancyGrid; an image; or what Nav2's map_server loads",
            content((Object = "application/json"), (Binary = "image/png"), (Binary = "application/zip"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_ogm(mut request: MapRequest) -> Result<Response, Problem> {
    let (lattice, params) = (&request.record.lattice, &mut request.params);
    let resolution = params.number("resolution", 1e-4, 1e4).unwrap_or(lattice.resolution);
    let kind = params.choice("kind", &KINDS);
    let mode = params.choice("mode", &Nav2Mode::ALL.map(|mode| (mode.name(), mode)));
    let [width, height] = OccupancyGrid::size(lattice, resolution);
    if width * height > LARGEST_GRID {
        params.fault("resolution", format!("gives {:.0} cells; the limit is {LARGEST_GRID:.0}", width * height));
    }
    let make = move |map: &FittedMap, record: &MapRecord, format, leash: &Leash| {
        let grid = OccupancyGrid::of_while(map, resolution, kind, &|| leash.holds())?;
        match format {
            PNG => Ok(grayscale_png(grid.width as u32, grid.height as u32, &grid.to_gray())?),
            ZIP => Ok(to_nav2_zip(&grid, mode)?),
            _ => to_json(&occupancy_json(&grid, record)),
        }
    };
    request.answer_while(&[JSON, PNG, ZIP], make).await
}

/// Rasters for planners: distance, sigma and clearance at cell centres, NaN where nothing was observed.
#[utoipa::path(get, operation_id = "get_map_grid", path = "/v1/maps/{id}/grid", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path),
        ("layers" = Option<String>, Query, pattern = "^(distance|sigma|clearance)(,(distance|sigma|clearance))*$", description = "distance, sigma, clearance; comma-separated, all by default"),
        ("resolution" = Option<f64>, Query, minimum = 0.0001, maximum = 10000, description = "metres a cell; the lattice's by default"),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "propagated (default) or posterior"),
        ("format" = Option<String>, Query, pattern = "^(npz|tiff)$", description = "npz or tiff")),
    responses((status = 200, description = "float32 arrays by the layers' names, lowest y first, with `origin` (the lower left corner) \
            and `resolution`; or a GeoTIFF with a band a layer and the same corner",
            content((Binary = "application/x-npz"), (Binary = "image/tiff"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_grid(mut request: MapRequest) -> Result<Response, Problem> {
    let (lattice, params) = (&request.record.lattice, &mut request.params);
    let resolution = params.number("resolution", 1e-4, 1e4).unwrap_or(lattice.resolution);
    let kind = params.choice("kind", &KINDS);
    let layers = raster_layers(params);
    let [width, height] = OccupancyGrid::size(lattice, resolution);
    if width * height > LARGEST_GRID {
        params.fault("resolution", format!("gives {:.0} cells; the limit is {LARGEST_GRID:.0}", width * height));
    }
    let make = move |map: &FittedMap, _: &MapRecord, format, leash: &Leash| {
        let rasters = Rasters::of_while(map, &layers, resolution, kind, &|| leash.holds())?;
        if format == TIFF { Ok(rasters.to_geotiff()?) } else { Ok(rasters.to_npz()?) }
    };
    request.answer_while(&[NPZ, TIFF], make).await
}

/// The map as a recording that ROS 2's tools, Lichtblick and Foxglove read.
#[utoipa::path(get, operation_id = "get_map_mcap", path = "/v1/maps/{id}/mcap", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path),
        ("resolution" = Option<f64>, Query, minimum = 0.0001, maximum = 10000, description = "metres a cell; the lattice's by default"),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "propagated (default) or posterior"),
        ("format" = Option<String>, Query, pattern = "^(mcap)$", description = "mcap")),
    responses((status = 200, description = "an MCAP file: `/map` (nav_msgs/OccupancyGrid, the same as `ogm`), `/grid` (foxglove.Grid with \
            float32 `distance` and `sigma`, the same as `grid`), `/tf_static`",
            content((Binary = "application/x-mcap"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_mcap(mut request: MapRequest) -> Result<Response, Problem> {
    let (lattice, params) = (&request.record.lattice, &mut request.params);
    let resolution = params.number("resolution", 1e-4, 1e4).unwrap_or(lattice.resolution);
    let kind = params.choice("kind", &KINDS);
    let [width, height] = OccupancyGrid::size(lattice, resolution);
    if width * height > LARGEST_GRID {
        params.fault("resolution", format!("gives {:.0} cells; the limit is {LARGEST_GRID:.0}", width * height));
    }
    let make = move |map: &FittedMap, record: &MapRecord, _, leash: &Leash| {
        let grid = OccupancyGrid::of_while(map, resolution, kind, &|| leash.holds())?;
        let layers = [RasterLayer::Distance, RasterLayer::Sigma];
        let rasters = Rasters::of_while(map, &layers, resolution, kind, &|| leash.holds())?;
        leash.goes_on()?;
        Ok(to_mcap(&grid, &rasters, &Stamp { frame: FRAME, milliseconds: record.created })?)
    };
    request.answer_while(&[MCAP], make).await
}

fn raster_layers(params: &mut Params) -> Vec<RasterLayer> {
    let Some(text) = params.text("layers").map(str::to_owned) else { return RasterLayer::ALL.into() };
    let mut layers = Vec::new();
    for name in text.split(',').map(str::trim) {
        match RasterLayer::ALL.into_iter().find(|layer| layer.name() == name) {
            Some(layer) if !layers.contains(&layer) => layers.push(layer),
            Some(_) => {}
            None => params.fault("layers", "must be distance, sigma or clearance, comma-separated"),
        }
    }
    layers
}

/// The field names of `nav_msgs/OccupancyGrid`.
fn occupancy_json(grid: &OccupancyGrid, record: &MapRecord) -> Value {
    json!({
        "header": {"frame_id": FRAME, "stamp": timestamp(record.created)},
        "info": {
            "map_load_time": timestamp(record.created),
            "resolution": grid.resolution,
            "width": grid.width,
            "height": grid.height,
            "origin": {
                "position": {"x": grid.origin[0], "y": grid.origin[1], "z": 0.0},
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
        },
        "data": grid.data,
    })
}

/// A picture with axes in metres, a colour bar, a legend and a scale bar.
#[utoipa::path(get, operation_id = "get_map_image", path = "/v1/maps/{id}/image", tag = "maps", security(("key" = ["read"])),
    params(("id" = String, Path),
        ("layer" = Option<String>, Query, pattern = "^(distance|sigma|occupancy)$", description = "distance (default), sigma or occupancy"),
        ("overlay" = Option<String>, Query, pattern = "^$|^(contour|points|poses|jumps)(,(contour|points|poses|jumps))*$", description = "contour, points, poses, jumps (where a vector map's field does); comma-separated"),
        ("kind" = Option<String>, Query, pattern = "^(propagated|posterior)$", description = "propagated (default) or posterior"),
        ("width" = Option<u32>, Query, minimum = 200, maximum = 4096, description = "pixels; type, lines and margins grow with it"),
        ("theme" = Option<String>, Query, pattern = "^(light|dark)$", description = "light (default) or dark"),
        ("format" = Option<String>, Query, pattern = "^(png|svg)$", description = "png or svg")),
    responses((status = 200, description = "the picture", content((Binary = "image/png"), (String = "image/svg+xml"))),
        (status = 304, description = "unchanged"),
        Refused))]
pub async fn get_map_image(mut request: MapRequest) -> Result<Response, Problem> {
    let params = &mut request.params;
    let layers = [("distance", Layer::Distance), ("sigma", Layer::Sigma), ("occupancy", Layer::Occupancy)];
    let layer = params.choice("layer", &layers);
    let overlays = overlays(params);
    let kind = params.choice("kind", &KINDS);
    let page = page(params, kind);
    let name = match layer {
        Layer::Distance => "distance",
        Layer::Sigma => "standard deviation of the distance",
        Layer::Occupancy => "occupancy",
    };
    let make = move |map: &FittedMap, record: &MapRecord, format, leash: &Leash| {
        let picture = Picture { layer, overlays, cell: None, page: Page { title: title(record, name), ..page } };
        let svg = map_picture_while(map, &picture, &|| leash.holds())?;
        leash.goes_on()?;
        if format == SVG { Ok(svg.into_bytes()) } else { Ok(svg_to_png(&svg)?) }
    };
    request.answer_while(&[PNG, SVG], make).await
}

/// What a picture is drawn on; its title is said later.
fn page(params: &mut Params, kind: Kind) -> Page {
    let width = params.number("width", WIDTHS.0, WIDTHS.1).unwrap_or(DEFAULT_WIDTH);
    Page { theme: params.choice("theme", &THEMES), kind, ..Page::new("", width) }
}

fn overlays(params: &mut Params) -> Vec<Overlay> {
    let text = params.text("overlay").unwrap_or_default().to_owned();
    let mut overlays = Vec::new();
    for name in text.split(',').map(str::trim).filter(|name| !name.is_empty()) {
        match name {
            "contour" => overlays.push(Overlay::Contour),
            "points" => overlays.push(Overlay::Points),
            "poses" => overlays.push(Overlay::Poses),
            "jumps" => overlays.push(Overlay::Jumps),
            _ => params.fault("overlay", "must be contour, points, poses or jumps, comma-separated"),
        }
    }
    // Points lie below lines, lines below poses, whatever order they were named in.
    let order = [Overlay::Points, Overlay::Jumps, Overlay::Contour, Overlay::Poses];
    overlays.sort_by_key(|overlay| order.iter().position(|o| o == overlay));
    overlays.dedup();
    overlays
}

pub(super) fn title(record: &MapRecord, what: &str) -> String {
    match &record.name {
        Some(name) => format!("{name}: {what}"),
        None => what.to_owned(),
    }
}
