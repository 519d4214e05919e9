//! A map as a recording that Lichtblick, Foxglove and ROS 2's own tools show: MCAP with one message a topic.
//!
//! | topic | type | what |
//! | --- | --- | --- |
//! | `/map` | `nav_msgs/msg/OccupancyGrid` (CDR) | the occupancy grid, as `ogm` has it |
//! | `/grid` | `foxglove.Grid` (protobuf) | float32 `distance` and `sigma` in metres, NaN where nothing was observed |
//! | `/tf_static` | `tf2_msgs/msg/TFMessage` (CDR) | where the lattice's corner lies in the map's frame: viewers draw only what hangs on a known frame |
//!
//! `foxglove.Grid` is protobuf because that is what its schema is written in, and what every reader of it takes. All
//! messages are stamped with the map's creation, so that the same map gives the same bytes.

mod foxglove;
mod messages;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

use mcap::{Channel, Compression, McapError, Message, Schema, WriteOptions, Writer};

use super::RenderError;
use super::occupancy::OccupancyGrid;
use super::rasters::Rasters;

/// Chunks are closed beyond so many bytes.
const CHUNK: u64 = 1 << 20;

/// Where a recording's messages are, and when.
#[derive(Debug, Clone, Copy)]
pub struct Stamp<'a> {
    /// The map's frame.
    pub frame: &'a str,
    /// When the map was made, milliseconds since 1970.
    pub milliseconds: i64,
}

impl Stamp<'_> {
    fn nanoseconds(&self) -> u64 {
        self.milliseconds.max(0) as u64 * 1_000_000
    }

    /// As `builtin_interfaces/Time`, which ends in 2038.
    fn parts(&self) -> (i32, u32) {
        let seconds = i32::try_from(self.milliseconds.max(0) / 1000).unwrap_or(i32::MAX);
        (seconds, (self.milliseconds.max(0) % 1000) as u32 * 1_000_000)
    }
}

/// The recording. Both grids have the map's lattice's corner as their own.
pub fn to_mcap(grid: &OccupancyGrid, rasters: &Rasters, stamp: &Stamp<'_>) -> Result<Vec<u8>, RenderError> {
    let options = WriteOptions::new()
        .profile("ros2")
        .library(concat!("mapfit ", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Zstd))
        .compression_threads(0)
        .chunk_size(Some(CHUNK));
    let mut writer = options.create(Cursor::new(Vec::new()))?;
    let mut topics = Topics { writer: &mut writer, count: 0, time: stamp.nanoseconds() };
    let tf =
        Kind { name: "tf2_msgs/msg/TFMessage", schema: Form::Ros(include_str!("../../../assets/ros/TFMessage.msg")) };
    topics.write("/tf_static", &tf, messages::corner(grid, stamp))?;
    let map = Kind {
        name: "nav_msgs/msg/OccupancyGrid",
        schema: Form::Ros(include_str!("../../../assets/ros/OccupancyGrid.msg")),
    };
    topics.write("/map", &map, messages::occupancy(grid, stamp))?;
    let raster = Kind { name: "foxglove.Grid", schema: Form::Protobuf(foxglove::DESCRIPTORS) };
    topics.write("/grid", &raster, foxglove::grid(rasters, stamp))?;
    writer.finish()?;
    Ok(writer.into_inner().into_inner())
}

/// A type of message: its name, and how it is said.
struct Kind {
    name: &'static str,
    schema: Form,
}

enum Form {
    /// `.msg` files, after one another.
    Ros(&'static str),
    /// A `FileDescriptorSet`.
    Protobuf(&'static [u8]),
}

struct Topics<'w> {
    writer: &'w mut Writer<Cursor<Vec<u8>>>,
    count: u16,
    time: u64,
}

impl Topics<'_> {
    fn write(&mut self, topic: &str, kind: &Kind, data: Vec<u8>) -> Result<(), McapError> {
        self.count += 1;
        let (encoding, message_encoding, definition) = match kind.schema {
            Form::Ros(text) => ("ros2msg", "cdr", text.as_bytes()),
            Form::Protobuf(set) => ("protobuf", "protobuf", set),
        };
        let schema = Schema {
            id: self.count,
            name: kind.name.into(),
            encoding: encoding.into(),
            data: Cow::Borrowed(definition),
        };
        // A latched topic: who comes later gets it, too.
        let quality = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n";
        let metadata = match kind.schema {
            Form::Ros(_) => BTreeMap::from([("offered_qos_profiles".into(), quality.into())]),
            Form::Protobuf(_) => BTreeMap::new(),
        };
        let channel = Channel {
            id: self.count,
            topic: topic.into(),
            schema: Some(Arc::new(schema)),
            message_encoding: message_encoding.into(),
            metadata,
        };
        let message = Message {
            channel: Arc::new(channel),
            sequence: 0,
            log_time: self.time,
            publish_time: self.time,
            data: Cow::Owned(data),
        };
        self.writer.write(&message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_map_gives_the_same_bytes() {
        let grid = OccupancyGrid {
            resolution: 0.5,
            width: 3,
            height: 2,
            origin: [-1.0, 2.0],
            data: vec![0, 50, 100, -1, 1, 99],
        };
        let rasters = Rasters { resolution: 0.5, origin: [-1.0, 2.0], width: 3, height: 2, layers: Vec::new() };
        let stamp = Stamp { frame: "map", milliseconds: 1_700_000_000_123 };
        let (a, b) = (to_mcap(&grid, &rasters, &stamp).unwrap(), to_mcap(&grid, &rasters, &stamp).unwrap());
        assert!(a == b && a.starts_with(mcap::MAGIC) && a.ends_with(mcap::MAGIC));
        assert_eq!(stamp.parts(), (1_700_000_000, 123_000_000));
    }
}
