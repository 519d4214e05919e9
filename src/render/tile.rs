//! Square pieces of a layer, for a viewer that pans and zooms: fetched by view, never whole.
//!
//! The tile `(x, y)` of level `z` covers `[x S, (x+1) S] x [y S, (y+1) S]` of the map's frame, `S = 1024 m / 2^z`, y
//! upwards; `x` and `y` may be negative. What is not observed is transparent. A tile's colours do not depend on what else
//! the map holds, so that tiles fit together: the scale ends where the viewer says.

use super::occupancy::probability;
use super::raster::rgba_png;
use super::theme::shade;
use super::{RenderError, Wanted, still};
use crate::fit::Distance;
use crate::geometry::Vec2;
use crate::map::{FittedMap, Sweep};
use crate::uncertainty::Kind;

/// Pixels of a side.
pub const SIDE: u32 = 256;
/// The finest level: a tile of 6 cm.
pub const FINEST: u32 = 14;
const COARSEST_SIDE: f64 = 1024.0;

/// What a tile shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TileLayer {
    Distance,
    Sigma,
    Clearance,
    Occupancy,
}

/// Which tile, of what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile {
    pub layer: TileLayer,
    pub level: u32,
    pub x: i32,
    pub y: i32,
    pub kind: Kind,
    /// For a dark page.
    pub dark: bool,
    /// Where the scale of colours ends, metres.
    pub most: f64,
}

/// A tile as PNG, as long as it is wanted.
pub fn tile(map: &FittedMap, tile: &Tile, wanted: Wanted) -> Result<Vec<u8>, RenderError> {
    let side = COARSEST_SIDE / f64::from(1u32 << tile.level.min(FINEST));
    let pixel = side / f64::from(SIDE);
    let mut sweep = Sweep::over(map, tile.kind);
    let mut pixels = vec![0; 4 * (SIDE * SIDE) as usize];
    for (row, line) in pixels.chunks_exact_mut(4 * SIDE as usize).enumerate() {
        still(wanted)?;
        let y = f64::from(tile.y) * side + (f64::from(SIDE) - row as f64 - 0.5) * pixel;
        for (column, color) in line.chunks_exact_mut(4).enumerate() {
            let p = Vec2::new(f64::from(tile.x) * side + (column as f64 + 0.5) * pixel, y);
            if let Some([r, g, b]) = color_at(map, &mut sweep, tile, (p, pixel)) {
                color.copy_from_slice(&[r, g, b, 255]);
            }
        }
    }
    rgba_png(SIDE, SIDE, &pixels)
}

fn color_at(map: &FittedMap, sweep: &mut Sweep<'_>, tile: &Tile, (p, pixel): (Vec2, f64)) -> Option<[u8; 3]> {
    if map.observed(p) != Some(true) {
        return None;
    }
    let mut distance = || sweep.distance(p).map(|(distance, _)| distance);
    let scaled = |value: f64| value / tile.most;
    let pick = |light, dark, t| shade(if tile.dark { dark } else { light }, t);
    match tile.layer {
        TileLayer::Distance if map.field.distance() == Distance::Signed => {
            distance().map(|distance| shade(colorous::RED_BLUE, 0.5 - 0.5 * scaled(distance)))
        }
        TileLayer::Distance => {
            distance().map(|distance| pick(colorous::YELLOW_GREEN_BLUE, colorous::INFERNO, scaled(distance)))
        }
        TileLayer::Sigma => sweep.seen_sigma(p).map(|sigma| shade(colorous::VIRIDIS, scaled(sigma))),
        TileLayer::Clearance => {
            map.clearance(p).map(|clearance| pick(colorous::YELLOW_GREEN, colorous::CIVIDIS, scaled(clearance)))
        }
        TileLayer::Occupancy => {
            // No finer than the lattice knows.
            let cell = pixel.max(0.25 * map.lattice().resolution);
            let share = probability(map, p, cell, tile.kind)?;
            Some(shade(colorous::GREYS, if tile.dark { 1.0 - share } else { share }))
        }
    }
}
