//! The occupancy grid as Nav2's map_server loads it: `map.yaml` beside the image it names.
//!
//! map_server has three ways to read a pixel (nav2_map_server, `map_io.cpp`), with `occ = 1 - shade`:
//!
//! ```text
//! trinary   occ over occupied_thresh: 100; under free_thresh: 0; else unknown
//! scale     transparent: unknown; else as trinary, and 100 (occ - free_thresh) / (occupied_thresh - free_thresh) between
//! raw       the pixel's value is the cell; what is not in 0..100 is unknown
//! ```
//!
//! In scale mode, trinary's thresholds would cut off what they pass and stretch the rest. Ours lie within one shade of 0
//! and 1, so every cell comes back as it is: 255 shades are finer than 100 steps. Versions differ about a value that
//! equals a threshold; no shade equals these.

use std::io::{Cursor, Write};

use zip::write::SimpleFileOptions;

use super::RenderError;
use super::occupancy::{OccupancyGrid, Trinary};
use super::raster::rgba_png;

/// How map_server is to read the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nav2Mode {
    Trinary,
    Scale,
    Raw,
}

impl Nav2Mode {
    pub const ALL: [Self; 3] = [Self::Trinary, Self::Scale, Self::Raw];

    /// As `map.yaml` has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Trinary => "trinary",
            Self::Scale => "scale",
            Self::Raw => "raw",
        }
    }

    /// A PGM has no alpha, which only scale mode needs.
    fn image(self) -> &'static str {
        match self {
            Self::Scale => "map.png",
            Self::Trinary | Self::Raw => "map.pgm",
        }
    }

    /// `occupied_thresh` and `free_thresh`; raw mode has no use for them, but map_server wants them there.
    fn thresholds(self) -> (f64, f64) {
        match self {
            Self::Scale => (0.998, 0.002),
            Self::Trinary | Self::Raw => (Trinary::OCCUPIED_FROM, Trinary::FREE_UP_TO),
        }
    }
}

/// A binary PGM of a grid's pixels, top row first.
fn pgm(grid: &OccupancyGrid, pixels: impl IntoIterator<Item = u8>) -> Vec<u8> {
    let mut pgm = format!("P5\n{} {}\n255\n", grid.width, grid.height).into_bytes();
    pgm.extend(pixels);
    pgm
}

/// The trinary image as a binary PGM, the highest y as its top row.
pub fn to_pgm(grid: &OccupancyGrid) -> Vec<u8> {
    pgm(grid, grid.to_gray())
}

/// The image of a mode.
fn image(grid: &OccupancyGrid, mode: Nav2Mode) -> Result<Vec<u8>, RenderError> {
    let cells = || grid.rows_from_the_top().flatten().copied();
    match mode {
        Nav2Mode::Trinary => Ok(to_pgm(grid)),
        // -1 as a byte is 255, as map_saver writes it.
        Nav2Mode::Raw => Ok(pgm(grid, cells().map(|cell| cell as u8))),
        Nav2Mode::Scale => {
            let pixels: Vec<u8> = cells().flat_map(shade).collect();
            rgba_png(grid.width as u32, grid.height as u32, &pixels)
        }
    }
}

/// A cell's shade, opaque; a transparent grey where it is unknown. All four channels, because map_saver found readers
/// that lose the alpha of a grey image.
fn shade(cell: i8) -> [u8; 4] {
    if cell < 0 {
        return [128, 128, 128, 0];
    }
    let gray = (255.0 * (100.0 - f64::from(cell)) / 100.0).round() as u8;
    [gray, gray, gray, 255]
}

/// The metadata beside it. `origin` is the lower left pixel's corner, with yaw.
pub fn to_yaml(grid: &OccupancyGrid, mode: Nav2Mode) -> String {
    let (occupied, free) = mode.thresholds();
    format!(
        "image: {}\nmode: {}\nresolution: {:?}\norigin: [{:?}, {:?}, 0.0]\nnegate: 0\noccupied_thresh: {occupied}\nfree_thresh: {free}\n",
        mode.image(),
        mode.name(),
        grid.resolution,
        grid.origin[0],
        grid.origin[1],
    )
}

/// A zip of both, the same bytes for the same grid.
pub fn to_nav2_zip(grid: &OccupancyGrid, mode: Nav2Mode) -> Result<Vec<u8>, RenderError> {
    let options = SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::DEFAULT);
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    archive.start_file("map.yaml", options)?;
    archive.write_all(to_yaml(grid, mode).as_bytes())?;
    archive.start_file(mode.image(), options)?;
    archive.write_all(&image(grid, mode)?)?;
    Ok(archive.finish()?.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// map_server's rule for an opaque pixel in scale mode.
    fn read(gray: u8) -> i8 {
        let (occupied, free) = Nav2Mode::Scale.thresholds();
        let occ = 1.0 - f64::from(gray) / 255.0;
        match occ {
            _ if occ > occupied => 100,
            _ if occ < free => 0,
            _ => (100.0 * (occ - free) / (occupied - free)).round() as i8,
        }
    }

    #[test]
    fn every_cell_comes_back_from_its_shade() {
        assert!((0..=100).all(|cell| read(shade(cell)[0]) == cell && shade(cell)[3] == 255));
        assert_eq!(shade(-1)[3], 0);
    }
}
