//! ROS 2 messages as CDR, little-endian: four bytes that say so, then the fields, each aligned to its size.

use re_cdr::{CdrWriter, LittleEndian};

use super::Stamp;
use crate::render::occupancy::OccupancyGrid;

/// CDR, little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

type Writer<'a> = CdrWriter<'a, LittleEndian>;

/// What `write` writes behind the four bytes, from which alignment counts.
fn message(write: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
    let mut bytes = ENCAPSULATION.to_vec();
    write(&mut Writer::new(&mut bytes));
    bytes
}

fn time(cdr: &mut Writer<'_>, stamp: &Stamp<'_>) {
    let (seconds, nanoseconds) = stamp.parts();
    cdr.write_i32(seconds);
    cdr.write_u32(nanoseconds);
}

/// A place without a turn: seven numbers, of a `Pose` as of a `Transform`.
fn place(cdr: &mut Writer<'_>, [x, y]: [f64; 2]) {
    [x, y, 0.0, 0.0, 0.0, 0.0, 1.0].into_iter().for_each(|value| cdr.write_f64(value));
}

/// `nav_msgs/OccupancyGrid`.
pub fn occupancy(grid: &OccupancyGrid, stamp: &Stamp<'_>) -> Vec<u8> {
    message(|cdr| {
        time(cdr, stamp);
        cdr.write_string(stamp.frame);
        time(cdr, stamp);
        cdr.write_f32(grid.resolution as f32);
        cdr.write_u32(grid.width as u32);
        cdr.write_u32(grid.height as u32);
        place(cdr, grid.origin);
        let cells: Vec<u8> = grid.data.iter().map(|cell| *cell as u8).collect();
        cdr.write_bytes(&cells);
    })
}

/// `tf2_msgs/TFMessage`: the frame `lattice`, whose origin is the lattice's lower left corner.
pub fn corner(grid: &OccupancyGrid, stamp: &Stamp<'_>) -> Vec<u8> {
    message(|cdr| {
        cdr.write_sequence_length(1);
        time(cdr, stamp);
        cdr.write_string(stamp.frame);
        cdr.write_string("lattice");
        place(cdr, grid.origin);
    })
}
