//! The lattice of control points: where cells lie and which control points they touch.
//!
//! A lattice of `nx x ny` cells with side `h` has `(nx+3) x (ny+3)` control points, ordered like an image, x fastest:
//! control point `(i, j)` has index `i + j (nx+3)`. Its origin is a multiple of `h`, so two maps of one resolution
//! share their cells.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::basis::{BasisRow, SUPPORT, cubic, product};
use crate::geometry::{Bounds, Vec2};

/// A uniform lattice; see the module for its layout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// The lower left corner of cell (0, 0), metres.
    pub origin: [f64; 2],
    /// The spacing `h` of control points and the side of a cell, metres.
    pub resolution: f64,
    /// The number of cells along x and y.
    pub cells: [usize; 2],
}

/// A point's cell and its local coordinates in it, both in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    pub cell: [usize; 2],
    pub local: [f64; 2],
}

#[derive(Debug, Error, PartialEq)]
pub enum LatticeError {
    #[error("the resolution must be a positive number of metres, not {0}")]
    Resolution(f64),
    #[error("the bounds are empty or inverted")]
    Bounds,
    #[error("this resolution needs {needed} control points, the limit is {limit}")]
    TooLarge { needed: f64, limit: usize },
}

impl Lattice {
    /// The smallest lattice aligned to multiples of `resolution` that covers `bounds`.
    ///
    /// The number of control points is checked against `limit` before anything of that size exists.
    pub fn covering(bounds: &Bounds, resolution: f64, limit: usize) -> Result<Self, LatticeError> {
        if !(resolution.is_finite() && resolution > 0.0) {
            return Err(LatticeError::Resolution(resolution));
        }
        let [width, height] = bounds.size();
        if !(width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite()) {
            return Err(LatticeError::Bounds);
        }
        let span = |axis: usize| {
            let first = snapped(bounds.min[axis] / resolution, f64::floor);
            let last = snapped(bounds.max[axis] / resolution, f64::ceil);
            (first, (last - first).max(1.0))
        };
        let ((x_first, nx), (y_first, ny)) = (span(0), span(1));
        let needed = (nx + 3.0) * (ny + 3.0);
        if needed.is_nan() || needed > limit as f64 {
            return Err(LatticeError::TooLarge { needed, limit });
        }
        Ok(Self { origin: [x_first * resolution, y_first * resolution], resolution, cells: [nx as usize, ny as usize] })
    }

    /// The number of control points along x and y.
    pub fn control_points(&self) -> [usize; 2] {
        [self.cells[0] + 3, self.cells[1] + 3]
    }

    /// The number of control points.
    pub fn len(&self) -> usize {
        let [nx, ny] = self.control_points();
        nx * ny
    }

    /// Whether the lattice has no control point; it never is where [`Lattice::covering`] made it.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of cells.
    pub fn cell_count(&self) -> usize {
        self.cells[0] * self.cells[1]
    }

    /// The rectangle the cells cover.
    pub fn bounds(&self) -> Bounds {
        let [x, y] = self.origin;
        let far = |start: f64, n: usize| start + n as f64 * self.resolution;
        Bounds { min: [x, y], max: [far(x, self.cells[0]), far(y, self.cells[1])] }
    }

    /// The cell a point lies in, or `None` outside the lattice. The upper and right edges belong to the last cells.
    pub fn locate(&self, p: Vec2) -> Option<Located> {
        let along = |value: f64, axis: usize| {
            let q = snapped((value - self.origin[axis]) / self.resolution, |q| q);
            let n = self.cells[axis] as f64;
            if !(0.0..=n).contains(&q) {
                return None;
            }
            let cell = q.floor().min(n - 1.0);
            Some((cell as usize, q - cell))
        };
        let ((i, t), (j, w)) = (along(p.x, 0)?, along(p.y, 1)?);
        Some(Located { cell: [i, j], local: [t, w] })
    }

    /// The nearest cell and the point's local coordinates in it, which lie outside [0, 1] for a point outside the
    /// lattice: the surface is then the nearest cell's polynomial, continued.
    pub fn locate_or_extend(&self, p: Vec2) -> Located {
        self.locate(p).unwrap_or_else(|| {
            let along = |value: f64, axis: usize| {
                let q = (value - self.origin[axis]) / self.resolution;
                let cell = q.floor().clamp(0.0, self.cells[axis] as f64 - 1.0);
                (cell as usize, q - cell)
            };
            let ((i, t), (j, w)) = (along(p.x, 0), along(p.y, 1));
            Located { cell: [i, j], local: [t, w] }
        })
    }

    /// The point at local coordinates of a cell.
    pub fn point(&self, cell: [usize; 2], local: [f64; 2]) -> Vec2 {
        Vec2::new(
            self.origin[0] + (cell[0] as f64 + local[0]) * self.resolution,
            self.origin[1] + (cell[1] as f64 + local[1]) * self.resolution,
        )
    }

    /// The index of a cell, x fastest.
    pub fn cell_index(&self, cell: [usize; 2]) -> usize {
        cell[0] + cell[1] * self.cells[0]
    }

    /// The indices of the 16 control points of a cell, in the order of [`BasisRow`].
    pub fn support(&self, cell: [usize; 2]) -> [usize; SUPPORT] {
        let row = self.cells[0] + 3;
        std::array::from_fn(|k| cell[0] + k % 4 + (cell[1] + k / 4) * row)
    }

    /// The basis row at a located point.
    pub fn row(&self, at: &Located) -> BasisRow {
        BasisRow::at(at.local[0], at.local[1], self.resolution)
    }

    /// The row of the value alone.
    pub fn value_row(&self, at: &Located) -> [f64; SUPPORT] {
        product(&cubic(at.local[0], 0), &cubic(at.local[1], 0), 1.0)
    }
}

/// The nearest integer where rounding noise alone keeps `q` from it (8 / 0.2 is not quite 40), else `otherwise(q)`.
fn snapped(q: f64, otherwise: impl Fn(f64) -> f64) -> f64 {
    let nearest = q.round();
    if (q - nearest).abs() <= 1e-9 * nearest.abs().max(1.0) { nearest } else { otherwise(q) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(min: [f64; 2], max: [f64; 2]) -> Bounds {
        Bounds { min, max }
    }

    #[test]
    fn experiment_one_has_2401_control_points() {
        let lattice = Lattice::covering(&bounds([-0.6, -0.6], [8.6, 8.6]), 0.2, 10_000).unwrap();
        assert_eq!((lattice.cells, lattice.len()), ([46, 46], 2401));
        assert!((lattice.origin[0] + 0.6).abs() < 1e-12);
    }

    #[test]
    fn a_lattice_is_aligned_to_multiples_of_its_resolution_and_covers_its_bounds() {
        let asked = bounds([0.13, -1.07], [2.01, 3.0]);
        let lattice = Lattice::covering(&asked, 0.25, 10_000).unwrap();
        assert_eq!(lattice.origin, [0.0, -1.25]);
        assert!(lattice.bounds().max[0] >= asked.max[0] && lattice.bounds().max[1] >= asked.max[1]);
    }

    #[test]
    fn edges_belong_to_the_lattice_and_what_lies_beyond_does_not() {
        let lattice = Lattice::covering(&bounds([0.0, 0.0], [1.0, 1.0]), 0.25, 1_000).unwrap();
        assert_eq!(lattice.locate(Vec2::new(1.0, 1.0)).unwrap(), Located { cell: [3, 3], local: [1.0, 1.0] });
        assert!(lattice.locate(Vec2::new(1.001, 0.5)).is_none());
        assert!(lattice.locate(Vec2::new(f64::NAN, 0.5)).is_none());
    }

    #[test]
    fn a_lattice_over_the_limit_is_refused_before_it_exists() {
        let refused = Lattice::covering(&bounds([0.0, 0.0], [1e300, 1e300]), 1e-300, 1_000);
        assert!(matches!(refused, Err(LatticeError::TooLarge { .. } | LatticeError::Bounds)));
    }
}
