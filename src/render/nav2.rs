//! The occupancy grid as Nav2's map_server loads it: `map.yaml` beside `map.pgm`, trinary.

use std::io::{Cursor, Write};

use zip::write::SimpleFileOptions;

use super::RenderError;
use super::occupancy::{OccupancyGrid, Trinary};

/// A binary PGM, the highest y as its top row.
pub fn to_pgm(grid: &OccupancyGrid) -> Vec<u8> {
    let mut pgm = format!("P5\n{} {}\n255\n", grid.width, grid.height).into_bytes();
    pgm.extend(grid.to_gray());
    pgm
}

/// The metadata beside it. `origin` is the lower left pixel's corner, with yaw.
pub fn to_yaml(grid: &OccupancyGrid) -> String {
    format!(
        "image: map.pgm\nmode: trinary\nresolution: {:?}\norigin: [{:?}, {:?}, 0.0]\nnegate: 0\noccupied_thresh: {}\nfree_thresh: {}\n",
        grid.resolution,
        grid.origin[0],
        grid.origin[1],
        Trinary::OCCUPIED_FROM,
        Trinary::FREE_UP_TO,
    )
}

/// A zip of both, the same bytes for the same grid.
pub fn to_nav2_zip(grid: &OccupancyGrid) -> Result<Vec<u8>, RenderError> {
    let options = SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::DEFAULT);
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    archive.start_file("map.yaml", options)?;
    archive.write_all(to_yaml(grid).as_bytes())?;
    archive.start_file("map.pgm", options)?;
    archive.write_all(&to_pgm(grid))?;
    Ok(archive.finish()?.into_inner())
}
