//! A map as something to look at or to hand on: contours, occupancy grids, pictures.
//!
//! Everything here takes a [`FittedMap`](crate::map::FittedMap) and gives numbers or bytes. A picture is described
//! once, as SVG (`figure`, laid out by `axes` in the colours of a `theme`), and rasterised with a font that is compiled
//! in (`raster`), so it looks the same on a host without fonts.

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

use thiserror::Error;

pub use axes::Axes;
pub use color_bar::ColorScale;
pub use contour::{Contours, contours};
pub use figure::Figure;
pub use geojson::to_geojson;
pub use nav2::{Nav2Mode, to_nav2_zip, to_pgm};
pub use occupancy::{OccupancyGrid, Trinary};
pub use overlay::{MOST_POSES, draw_contours, draw_poses};
pub use picture::{Layer, Overlay, Page, Picture, contour_picture, map_figure, map_picture};
pub use raster::{grayscale_png, rgba_png, svg_to_png};
pub use rasters::{RasterLayer, Rasters};
pub use ros::{Stamp, to_mcap};
pub use sheet::Sheet;
pub use theme::Theme;
pub(crate) use theme::shade;
pub use tile::{FINEST, Tile, TileLayer, tile};

#[derive(Debug, Error)]
pub enum RenderError {
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
