//! Rasters for planners: distance, its sigma and the clearance at cell centres, as arrays and as GeoTIFF.
//!
//! NaN where nothing was observed. Arrays have the lowest y first; a GeoTIFF, as its readers want it, the highest, with
//! the same lower left corner and no projection: metres of the map's frame.

use std::io::Cursor;

use geotiff_writer::{Compression, GeoTiffBuilder, ModelType};
use ndarray::Array3;

use super::occupancy::OccupancyGrid;
use super::{RenderError, Wanted, still};
use crate::geometry::Vec2;
use crate::map::FittedMap;
use crate::map::npz::{NpzError, NpzWriter};
use crate::uncertainty::Kind;

/// What a raster shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RasterLayer {
    Distance,
    Sigma,
    Clearance,
}

impl RasterLayer {
    pub const ALL: [Self; 3] = [Self::Distance, Self::Sigma, Self::Clearance];

    pub fn name(self) -> &'static str {
        match self {
            Self::Distance => "distance",
            Self::Sigma => "sigma",
            Self::Clearance => "clearance",
        }
    }
}

/// Layers over a map, row-major from the lower left.
#[derive(Debug, Clone, PartialEq)]
pub struct Rasters {
    /// Metres a cell.
    pub resolution: f64,
    /// The lower left corner, metres.
    pub origin: [f64; 2],
    pub width: usize,
    pub height: usize,
    pub layers: Vec<(RasterLayer, Vec<f32>)>,
}

impl Rasters {
    /// The layers over a map, as long as they are wanted. The caller bounds [`OccupancyGrid::size`] first.
    pub fn of_while(
        map: &FittedMap,
        layers: &[RasterLayer],
        resolution: f64,
        kind: Kind,
        wanted: Wanted,
    ) -> Result<Self, RenderError> {
        let [width, height] = OccupancyGrid::size(map.lattice(), resolution).map(|n| n as usize);
        let origin = map.lattice().origin;
        let center = |k: usize| {
            let at = |n: usize, axis: usize| origin[axis] + (n as f64 + 0.5) * resolution;
            Vec2::new(at(k % width, 0), at(k / width, 1))
        };
        let mut layers: Vec<(RasterLayer, Vec<f32>)> =
            layers.iter().map(|layer| (*layer, vec![f32::NAN; width * height])).collect();
        let measured = layers.iter().any(|(layer, _)| *layer != RasterLayer::Clearance);
        for k in 0..width * height {
            if k % width == 0 {
                still(wanted)?;
            }
            let p = center(k);
            if map.observed(p) != Some(true) {
                continue;
            }
            let distance = if measured { map.distance(p, kind) } else { None };
            for (layer, values) in &mut layers {
                let value = match layer {
                    RasterLayer::Distance => distance.map(|(distance, _)| distance),
                    RasterLayer::Sigma => distance.map(|(_, sigma)| sigma),
                    RasterLayer::Clearance => map.clearance(p),
                };
                values[k] = value.map_or(f32::NAN, |value| value as f32);
            }
        }
        Ok(Self { resolution, origin, width, height, layers })
    }

    /// Arrays by the layers' names, with `origin` and `resolution`.
    pub fn to_npz(&self) -> Result<Vec<u8>, NpzError> {
        let mut npz = NpzWriter::default();
        for (layer, values) in &self.layers {
            npz.array(layer.name(), &[self.height, self.width], values)?;
        }
        npz.array("origin", &[2], &self.origin)?.array("resolution", &[], &[self.resolution])?;
        npz.finish()
    }

    /// A GeoTIFF with a band a layer.
    pub fn to_geotiff(&self) -> Result<Vec<u8>, RenderError> {
        let top = self.origin[1] + self.height as f64 * self.resolution;
        let bands = Array3::from_shape_fn((self.height, self.width, self.layers.len()), |(row, column, band)| {
            self.layers[band].1[column + (self.height - 1 - row) * self.width]
        });
        let mut file = Cursor::new(Vec::new());
        GeoTiffBuilder::new(self.width as u32, self.height as u32)
            .bands(self.layers.len() as u32)
            .model_type(ModelType::Projected)
            .pixel_scale(self.resolution, self.resolution)
            .origin(self.origin[0], top)
            .nodata("nan")
            .compression(Compression::Deflate)
            .write_3d_to(&mut file, bands.view())?;
        Ok(file.into_inner())
    }
}
