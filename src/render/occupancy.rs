//! Occupancy grid maps: the probability that a surface passes within half a cell of a cell's centre.
//!
//! With mean `u` and standard deviation `s` of the distance at the centre, and cells of side `r`,
//! `P = Phi((r/2 - u)/s) - Phi((-r/2 - u)/s)`. A cell is known where a beam passed, or where a surface was met in it
//! and the distance agrees that it may be there; what lies behind a wall stays unknown.

use super::{RenderError, Wanted, still};
use crate::geometry::Vec2;
use crate::map::{FittedMap, normal_cdf};
use crate::scan::{SUBCELLS, Seen};
use crate::spline::Lattice;
use crate::uncertainty::Kind;

/// An occupancy grid with the conventions of `nav_msgs/OccupancyGrid`.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid {
    pub resolution: f64,
    pub width: usize,
    pub height: usize,
    /// The lower left corner, metres.
    pub origin: [f64; 2],
    /// Row-major from the lower left: 0 to 100, or -1 for unknown.
    pub data: Vec<i8>,
}

/// What Nav2 makes of a cell with the thresholds 0.65 and 0.196.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trinary {
    Free,
    Occupied,
    Unknown,
}

impl Trinary {
    pub const OCCUPIED_FROM: f64 = 0.65;
    pub const FREE_UP_TO: f64 = 0.196;

    pub fn of(cell: i8) -> Self {
        match f64::from(cell) / 100.0 {
            p if p < 0.0 => Self::Unknown,
            p if p >= Self::OCCUPIED_FROM => Self::Occupied,
            p if p <= Self::FREE_UP_TO => Self::Free,
            _ => Self::Unknown,
        }
    }

    /// The grey value of Nav2's map_saver.
    pub fn gray(self) -> u8 {
        match self {
            Self::Free => 254,
            Self::Occupied => 0,
            Self::Unknown => 205,
        }
    }
}

impl OccupancyGrid {
    /// The number of cells along x and y that cover a lattice at a resolution; not finite for a resolution of zero.
    pub fn size(lattice: &Lattice, resolution: f64) -> [f64; 2] {
        lattice.bounds().size().map(|side| (side / resolution - 1e-9).ceil().max(1.0))
    }

    /// The grid over a map. The caller bounds [`OccupancyGrid::size`] first.
    pub fn of(map: &FittedMap, resolution: f64, kind: Kind) -> Self {
        let mut grid = Self::unknown(map, resolution);
        (0..grid.height).for_each(|row| grid.fill(map, row, kind));
        grid
    }

    /// The grid over a map, as long as it is wanted.
    pub fn of_while(map: &FittedMap, resolution: f64, kind: Kind, wanted: Wanted) -> Result<Self, RenderError> {
        let mut grid = Self::unknown(map, resolution);
        for row in 0..grid.height {
            still(wanted)?;
            grid.fill(map, row, kind);
        }
        Ok(grid)
    }

    fn unknown(map: &FittedMap, resolution: f64) -> Self {
        let [width, height] = Self::size(map.lattice(), resolution).map(|n| n as usize);
        Self { resolution, width, height, origin: map.lattice().origin, data: vec![-1; width * height] }
    }

    fn fill(&mut self, map: &FittedMap, row: usize, kind: Kind) {
        let (origin, resolution) = (self.origin, self.resolution);
        let at = |k: usize, axis: usize| origin[axis] + (k as f64 + 0.5) * resolution;
        for (i, data) in self.data[row * self.width..][..self.width].iter_mut().enumerate() {
            *data = cell(map, Vec2::new(at(i, 0), at(row, 1)), resolution, kind);
        }
    }

    /// The rows from the highest y down, as an image wants them.
    pub fn rows_from_the_top(&self) -> impl Iterator<Item = &[i8]> {
        self.data.chunks_exact(self.width).rev()
    }

    /// The trinary image, top row first.
    pub fn to_gray(&self) -> Vec<u8> {
        self.rows_from_the_top().flatten().map(|&cell| Trinary::of(cell).gray()).collect()
    }
}

fn cell(map: &FittedMap, center: Vec2, resolution: f64, kind: Kind) -> i8 {
    probability(map, center, resolution, kind).map_or(-1, |probability| (100.0 * probability).round() as i8)
}

/// The probability that a surface passes a cell; `None` where nothing is known.
pub(super) fn probability(map: &FittedMap, center: Vec2, resolution: f64, kind: Kind) -> Option<f64> {
    let seen = seen_within(map, center, resolution / 2.0);
    let (u, sigma) = map.distance(center, kind).filter(|_| seen.any())?;
    if !seen.free && u.abs() > resolution / 2.0 + 2.0 * sigma {
        return None;
    }
    Some(within(u, sigma, resolution / 2.0)).filter(|probability| probability.is_finite())
}

/// What is known of the square around a point: its own mark, and all marks whose centres lie in it.
fn seen_within(map: &FittedMap, center: Vec2, half: f64) -> Seen {
    let lattice = map.lattice();
    let mut seen = map.evidence.at(lattice, center);
    let side = lattice.resolution / SUBCELLS as f64;
    let span = |axis: usize| {
        let low = ((center[axis] - half - lattice.origin[axis]) / side - 0.5).ceil().max(0.0) as usize;
        let high = ((center[axis] + half - lattice.origin[axis]) / side - 0.5).floor() + 1.0;
        low..(high.max(0.0) as usize).min(map.evidence.size()[axis])
    };
    for j in span(1) {
        for i in span(0) {
            let mark = map.evidence.mark(i, j);
            seen = Seen { free: seen.free || mark.free, surface: seen.surface || mark.surface };
        }
    }
    seen
}

/// The probability that a normal variable lies within `half` of zero.
pub(crate) fn within(mean: f64, sigma: f64, half: f64) -> f64 {
    if sigma <= 0.0 {
        return f64::from(mean.abs() <= half);
    }
    normal_cdf((half - mean) / sigma) - normal_cdf((-half - mean) / sigma)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_are_those_of_a_normal_variable() {
        assert!((within(0.0, 1.0, 1.0) - 0.682_689).abs() < 1e-5);
        assert!((within(0.1, 0.1, 0.1) - 0.477_250).abs() < 1e-5);
        assert_eq!((within(0.05, 0.0, 0.1), within(0.2, 0.0, 0.1)), (1.0, 0.0));
        assert!(within(-3.0, 0.01, 0.1) < 1e-9);
    }

    #[test]
    fn thresholds_are_those_of_nav2() {
        let read = [-1, 0, 19, 20, 64, 65, 100].map(Trinary::of);
        use Trinary::*;
        assert_eq!(read, [Unknown, Free, Free, Unknown, Unknown, Occupied, Occupied]);
    }
}
