//! Changes as GeoJSON (RFC 7946), and drawn over the newer map's walls.

use serde_json::{Value, json};

use super::changes::{Change, ChangeRole};
use crate::geometry::Vec2;
use crate::map::FittedMap;
use crate::render::{Axes, Figure, RenderError, contours, draw_contours};
use crate::uncertainty::Kind;

/// A FeatureCollection with a polygon a change, in metres of the maps' frame.
pub fn changes_geojson(changes: &[Change], frame_id: &str) -> Value {
    let rounded = |v: f64| (v * 1e6).round() / 1e6;
    let features: Vec<Value> = changes
        .iter()
        .map(|change| {
            let ring: Vec<Value> =
                change.polygon.exterior().0.iter().map(|p| json!([rounded(p.x), rounded(p.y)])).collect();
            json!({
                "type": "Feature",
                "properties": {
                    "role": change.role.name(),
                    "probability": change.probability,
                    "area": rounded(change.area),
                },
                "geometry": {"type": "Polygon", "coordinates": [ring]},
            })
        })
        .collect();
    json!({
        "type": "FeatureCollection",
        "frame": {"frame_id": frame_id, "units": "m"},
        "features": features,
    })
}

/// The changes over the walls of the newer map, as SVG: red what appeared, blue what vanished.
pub fn changes_picture(new: &FittedMap, changes: &[Change], width: usize, title: &str) -> Result<String, RenderError> {
    let mut figure = Figure::new(Axes::new(new.lattice().bounds(), width), title);
    draw_contours(&contours(new, 0.0, None, Kind::Propagated)?, &mut figure);
    for change in changes {
        let ring: Vec<Vec2> = change.polygon.exterior().0.iter().map(|p| Vec2::new(p.x, p.y)).collect();
        let color = match change.role {
            ChangeRole::Appeared => "#d7191c",
            ChangeRole::Vanished => "#2c7bb6",
        };
        let style = format!("fill=\"{color}\" fill-opacity=\"0.45\" stroke=\"{color}\" stroke-width=\"1.2\"");
        figure.path(std::iter::once(ring.as_slice()), true, &style);
        figure.legend(&[(change.role.name(), color)]);
    }
    Ok(figure.finish())
}
