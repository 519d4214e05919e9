//! `foxglove.Grid` as protobuf: few fields, so the wire format is written by hand.
//!
//! A field is a tag (`8 * number + wire type`) and a value: 1 is eight bytes, 5 four bytes, 2 a length and that many bytes, 0 a
//! varint (<https://protobuf.dev/programming-guides/encoding>). Numbers are those of `foxglove/Grid.proto`.

use super::Stamp;
use crate::render::rasters::Rasters;

/// The schema: a `FileDescriptorSet` of `foxglove/Grid.proto` and what it imports.
pub const DESCRIPTORS: &[u8] = include_bytes!("../../../assets/foxglove/Grid.bin");

/// `NumericType.FLOAT32` of `foxglove.PackedElementField`.
const FLOAT32: u64 = 7;
/// Bytes of a float32.
const BYTES: usize = 4;

#[derive(Default)]
struct Wire(Vec<u8>);

impl Wire {
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn number(mut self, field: u64, value: u64) -> Self {
        self.varint(8 * field);
        self.varint(value);
        self
    }

    fn double(mut self, field: u64, value: f64) -> Self {
        self.varint(8 * field + 1);
        self.0.extend(value.to_le_bytes());
        self
    }

    fn fixed(mut self, field: u64, value: usize) -> Self {
        self.varint(8 * field + 5);
        self.0.extend((value as u32).to_le_bytes());
        self
    }

    fn bytes(mut self, field: u64, value: &[u8]) -> Self {
        self.varint(8 * field + 2);
        self.varint(value.len() as u64);
        self.0.extend_from_slice(value);
        self
    }

    fn message(self, field: u64, value: Wire) -> Self {
        self.bytes(field, &value.0)
    }

    /// `Vector2`, `Vector3` or `Quaternion`: doubles numbered from 1.
    fn doubles(values: &[f64]) -> Self {
        values.iter().zip(1..).fold(Self::default(), |wire, (value, field)| wire.double(field, *value))
    }
}

/// A raster's layers as fields of one grid, lowest y first.
pub fn grid(rasters: &Rasters, stamp: &Stamp<'_>) -> Vec<u8> {
    let stride = BYTES * rasters.layers.len();
    let cells = rasters.width * rasters.height;
    let mut data = Vec::with_capacity(cells * stride);
    for cell in 0..cells {
        for (_, values) in &rasters.layers {
            data.extend(values[cell].to_le_bytes());
        }
    }
    let (seconds, nanoseconds) = stamp.parts();
    let time = Wire::default().number(1, seconds as u64).number(2, u64::from(nanoseconds));
    let [x, y] = rasters.origin;
    let pose = Wire::default().message(1, Wire::doubles(&[x, y, 0.0])).message(2, Wire::doubles(&[0.0, 0.0, 0.0, 1.0]));
    let mut wire = Wire::default()
        .message(1, time)
        .bytes(2, stamp.frame.as_bytes())
        .message(3, pose)
        .fixed(4, rasters.width)
        .message(5, Wire::doubles(&[rasters.resolution; 2]))
        .fixed(6, rasters.width * stride)
        .fixed(7, stride);
    for (k, (layer, _)) in rasters.layers.iter().enumerate() {
        let field = Wire::default().bytes(1, layer.name().as_bytes()).fixed(2, BYTES * k).number(3, FLOAT32);
        wire = wire.message(8, field);
    }
    wire.bytes(9, &data).0
}
