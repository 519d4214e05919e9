//! A map as something to look at or to hand on: contours, occupancy grids, pictures.
//!
//! Everything here takes a [`FittedMap`](crate::map::FittedMap) and gives numbers or bytes. A picture is described
//! once, as SVG (`figure`, laid out by `axes` in the colours of a `theme`), and rasterised with a font that is compiled
//! in (`raster`), so it looks the same on a host without fonts.
//!
//! What may take seconds has a second name, `..._while`, under which it asks again and again whether it is still
//! [`Wanted`], and ends with [`RenderError::Unwanted`] where it is not.

mod axes;
mod color_bar;
mod contour;
mod figure;
mod geojson;
mod legend;
mod nav2;
mod occupancy;
mod overlay;
mod picture;
mod raster;
mod rasters;
mod ros;
mod sheet;
mod text;
mod theme;
mod tile;

use std::cell::Cell;

use thiserror::Error;

pub use axes::Axes;
pub use color_bar::ColorScale;
pub use contour::{Contours, contours, contours_while};
pub use figure::Figure;
pub use geojson::to_geojson;
pub use nav2::{Nav2Mode, to_nav2_zip, to_pgm};
pub use occupancy::{OccupancyGrid, Trinary};
pub use overlay::{MOST_POSES, draw_contours, draw_poses};
pub use picture::{Layer, Overlay, Page, Picture, contour_picture, map_figure, map_picture, map_picture_while};
pub use raster::{grayscale_png, rgba_png, svg_to_png};
pub use rasters::{RasterLayer, Rasters};
pub use ros::{Stamp, to_mcap};
pub use sheet::Sheet;
pub use theme::Theme;
pub(crate) use theme::shade;
pub use tile::{FINEST, Tile, TileLayer, tile};

/// Whether somebody still waits for what is being made. Once it says no it goes on saying so.
pub type Wanted<'a> = &'a dyn Fn() -> bool;

/// Of whoever waits for the end, however long it takes.
const ALWAYS: Wanted<'static> = &|| true;

/// An error where nobody waits any more.
fn still(wanted: Wanted) -> Result<(), RenderError> {
    if wanted() { Ok(()) } else { Err(RenderError::Unwanted) }
}

/// The same question for a loop over points: a point may take less time than asking does.
fn asked_seldom<'a>(wanted: Wanted<'a>) -> impl Fn() -> bool + 'a {
    const POINTS: u32 = 256;
    let (passed, held) = (Cell::new(0), Cell::new(true));
    move || {
        if passed.replace(passed.get() + 1) % POINTS == 0 {
            held.set(held.get() && wanted());
        }
        held.get()
    }
}

#[derive(Debug, Error)]
pub enum RenderError {
    #[error("nobody waits for it any more")]
    Unwanted,
    #[error("a contour could not be traced: {0}")]
    Contour(#[from] ::contour::Error),
    #[error("an image could not be encoded: {0}")]
    Png(#[from] png::EncodingError),
    #[error("a picture could not be drawn: {0}")]
    Svg(String),
    #[error("an archive could not be written: {0}")]
    Zip(#[from] zip::result::ZipError),
    #[error("a recording could not be written: {0}")]
    Mcap(#[from] mcap::McapError),
    #[error("a GeoTIFF could not be written: {0}")]
    GeoTiff(#[from] geotiff_writer::Error),
    #[error("an archive could not be written: {0}")]
    Io(#[from] std::io::Error),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Survey;
    use crate::sim::Scenario;
    use crate::uncertainty::Kind;

    /// What makes something as long as it is wanted.
    type Maker<'a> = &'a dyn Fn(Wanted) -> Result<(), RenderError>;

    /// Whoever waits leaves after three questions.
    #[test]
    fn what_nobody_wants_any_more_is_left_at_once() {
        let room = Scenario::experiment_one();
        let map = Survey::new(&room.scans(1), room.noise).resolution(0.5).map().unwrap();
        let kind = Kind::Propagated;
        let picture = |layer| Picture { layer, overlays: vec![Overlay::Contour], cell: None, page: Page::new("", 900) };
        let piece = Tile { layer: TileLayer::Sigma, level: 8, x: 0, y: 0, kind, dark: false, most: 1.0 };
        let drawn = |layer, wanted: Wanted| map_picture_while(&map, &picture(layer), wanted).map(drop);
        let makers: [(&str, Maker); 7] = [
            ("grid", &|wanted| OccupancyGrid::of_while(&map, 0.05, kind, wanted).map(drop)),
            ("rasters", &|wanted| Rasters::of_while(&map, &RasterLayer::ALL, 0.05, kind, wanted).map(drop)),
            ("a level and its band", &|wanted| contours_while(&map, 0.5, Some(2.0), kind, wanted).map(drop)),
            ("tile", &|wanted| tile(&map, &piece, wanted).map(drop)),
            ("picture of the distance", &|wanted| drawn(Layer::Distance, wanted)),
            ("picture of sigma", &|wanted| drawn(Layer::Sigma, wanted)),
            ("picture of the occupancy", &|wanted| drawn(Layer::Occupancy, wanted)),
        ];
        for (name, make) in makers {
            let asked = Cell::new(0);
            let ask = |holds: u32| {
                asked.set(0);
                make(&|| asked.replace(asked.get() + 1) < holds)
            };
            assert!(ask(u32::MAX).is_ok(), "{name}");
            let whole = asked.get();
            assert!(whole > 6, "{name} is made in one go");
            assert!(matches!(ask(3), Err(RenderError::Unwanted)), "{name}");
            assert!(asked.get() <= 5, "{name}: of {whole} questions {} after the last yes", asked.get() - 3);
        }
    }
}
