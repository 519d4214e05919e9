//! What one return says of its scan's pose: how far it lies across the surface that it should have met.
//!
//! On a signed map that is Sampson's distance, `d / |grad d|`. On a vector map `|V|` folds at a surface and a thin wall has
//! two of them a hand apart, so the residual is that to the nearest facet which *faces* the robot: a beam cannot have met
//! the other side. Either way the derivative by the coefficients is the basis row there over the slope, or along the normal.

use crate::fit::Distance;
use crate::geometry::{Pose, Vec2, projection_by_pose};
use crate::map::{FittedMap, STRAY};
use crate::spline::SUPPORT;
use nalgebra::Vector3;

/// A slope below this is no distance's: the cut locus, or the inside of a wall.
const LEAST_SLOPE: f64 = 0.3;

/// A beam that met something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    pub bearing: f64,
    /// Metres.
    pub range: f64,
}

/// A return against the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Metres, across the surface.
    pub residual: f64,
    /// Its derivative by (x, y, theta).
    pub by_pose: Vector3<f64>,
    /// The cosine between beam and normal: how much of the range's noise is across the surface.
    pub incidence: f64,
    /// The surface's unit normal, and where on the map the residual is read.
    pub normal: Vec2,
    pub place: Vec2,
    /// What the basis row is to be divided by.
    pub slope: f64,
}

/// What a beam met, so far as it has to be looked for: a vector map's facet. It is kept while a pose hardly moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Met {
    /// A signed map's surface is where the field vanishes, within so many metres.
    Field(f64),
    Facet(usize),
}

impl Met {
    /// What a beam from a pose met; `None` where the map has no surface within `reach` metres.
    pub fn of(map: &FittedMap, pose: &Pose, beam: &Beam, reach: f64) -> Option<Self> {
        match map.field.distance() {
            Distance::Signed => Some(Self::Field(reach)),
            Distance::Vector => {
                let direction = pose.direction(beam.bearing);
                map.surfaces.facing(pose.position() + direction * beam.range, direction, reach).map(Self::Facet)
            }
        }
    }
}

impl Sighting {
    /// A beam's return from a pose, against what it met; `None` where the map has nothing to hold it against.
    pub fn of(map: &FittedMap, pose: &Pose, beam: &Beam, met: Met) -> Option<Self> {
        let direction = pose.direction(beam.bearing);
        let point = pose.position() + direction * beam.range;
        let (residual, normal, place, slope) = match met {
            Met::Field(reach) => {
                let (value, gradient) = map.field.slope(point)?;
                let slope = gradient.norm();
                if !(slope > LEAST_SLOPE && value.abs() <= reach * slope) {
                    return None;
                }
                (value / slope, gradient / slope, point, slope)
            }
            Met::Facet(facet) => {
                let facing = map.surfaces.before(facet, point);
                (facing.across, facing.normal, facing.foot, 1.0)
            }
        };
        let by_point = projection_by_pose(direction * beam.range);
        Some(Self {
            residual,
            by_pose: by_point.transpose() * normal,
            incidence: normal.dot(&direction),
            normal,
            place,
            slope,
        })
    }

    /// The residual's derivatives by the map's coefficients: (index, value), the x set before the y set.
    pub fn by_coefficients(&self, map: &FittedMap) -> Option<Vec<(usize, f64)>> {
        let at = map.field.locate(self.place)?;
        let lattice = map.lattice();
        let (row, support) = (lattice.row(&at).value, lattice.support(at.cell));
        let along: &[f64] = match map.field.distance() {
            Distance::Signed => &[1.0 / self.slope],
            Distance::Vector => &[self.normal.x, self.normal.y],
        };
        let sets = along.iter().enumerate();
        Some(
            sets.flat_map(|(k, share)| (0..SUPPORT).map(move |n| (k * lattice.len() + support[n], share * row[n])))
                .collect(),
        )
    }

    /// The variance of its residual without the map's own, square metres.
    pub fn variance(&self, sigma_range: f64, resolution: f64) -> f64 {
        (sigma_range * self.incidence).powi(2) + (STRAY * resolution).powi(2)
    }
}
