//! Contours as GeoJSON (RFC 7946), with coordinates in metres of the map's frame and a foreign member that says so.

use geo_types::{Coord, LineString};
use serde_json::{Value, json};

use super::contour::Contours;

/// A FeatureCollection: one feature with role `level`, and one with role `band` where there is a band.
pub fn to_geojson(contours: &Contours, frame_id: &str) -> Value {
    let lines: Vec<Value> = contours.lines.0.iter().map(positions).collect();
    let mut features = vec![json!({
        "type": "Feature",
        "properties": {"role": "level", "level": contours.level},
        "geometry": {"type": "MultiLineString", "coordinates": lines},
    })];
    if let Some((sigmas, band)) = &contours.band {
        let polygons: Vec<Value> = band
            .0
            .iter()
            .map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(positions).collect())
            .collect();
        features.push(json!({
            "type": "Feature",
            "properties": {"role": "band", "level": contours.level, "sigmas": sigmas},
            "geometry": {"type": "MultiPolygon", "coordinates": polygons},
        }));
    }
    json!({
        "type": "FeatureCollection",
        "frame": {"frame_id": frame_id, "units": "m"},
        "features": features,
    })
}

/// Positions to the micrometre, far below any map's uncertainty.
fn positions(line: &LineString<f64>) -> Value {
    let rounded = |v: f64| (v * 1e6).round() / 1e6;
    line.0.iter().map(|Coord { x, y }| json!([rounded(*x), rounded(*y)])).collect()
}
