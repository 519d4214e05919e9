//! A regular grid of points over the lattice, finer than it: what level lines are traced on.

use ::contour::{ContourBuilder, Error};
use geo_types::Coord;

use crate::geometry::Vec2;
use crate::spline::Lattice;

/// Samples a cell's side, where the map is not too large for it.
pub(crate) const FINEST: usize = 8;
/// Samples a contour is traced on at most.
const MOST_SAMPLES: usize = 4_000_000;

/// The grid, edges included.
pub(crate) struct Samples {
    pub origin: [f64; 2],
    pub step: f64,
    pub size: [usize; 2],
}

impl Samples {
    pub fn over(lattice: &Lattice) -> Self {
        let per_cell = (1..=FINEST).rev().find(|k| lattice.cell_count() * k * k <= MOST_SAMPLES).unwrap_or(1);
        Self {
            origin: lattice.origin,
            step: lattice.resolution / per_cell as f64,
            size: lattice.cells.map(|n| n * per_cell + 1),
        }
    }

    /// Where sample `k` lies, x fastest.
    pub fn place(&self, k: usize) -> Vec2 {
        let at = |n: usize, axis: usize| self.origin[axis] + n as f64 * self.step;
        Vec2::new(at(k % self.size[0], 0), at(k / self.size[0], 1))
    }

    pub fn collect(&self, value: impl Fn(Vec2) -> f64) -> Vec<f64> {
        (0..self.size[0] * self.size[1]).map(|k| value(self.place(k))).collect()
    }

    pub fn tracer(&self) -> ContourBuilder {
        ContourBuilder::new(self.size[0], self.size[1], true)
    }

    /// The tracer puts sample (i, j) at (i + 1/2, j + 1/2).
    pub fn to_world(&self, p: Coord<f64>) -> Vec2 {
        Vec2::new(self.origin[0] + (p.x - 0.5) * self.step, self.origin[1] + (p.y - 0.5) * self.step)
    }

    /// The lines on which the samples' values vanish.
    pub fn zero_lines(&self, values: &[f64]) -> Result<Vec<Vec<Vec2>>, Error> {
        let traced = self.tracer().lines(values, &[0.0])?;
        let rings = traced.iter().flat_map(|line| &line.geometry().0);
        let runs = rings.flat_map(|ring| self.open_runs(&ring.0));
        Ok(runs.map(|run| run.into_iter().map(|p| self.to_world(p)).collect()).collect())
    }

    /// A traced ring without the pieces along the grid's edge, where the tracer closes every line.
    fn open_runs(&self, ring: &[Coord<f64>]) -> Vec<Vec<Coord<f64>>> {
        let [nx, ny] = self.size.map(|n| n as f64);
        let on_edge = |p: &Coord<f64>| p.x <= 0.0 || p.y <= 0.0 || p.x >= nx || p.y >= ny;
        let corners = ring.len().saturating_sub(1);
        let Some(first) = ring[..corners].iter().position(on_edge) else { return vec![ring.to_vec()] };
        let mut runs = vec![Vec::new()];
        for k in 1..=corners {
            let p = ring[(first + k) % corners];
            match runs.last_mut() {
                Some(run) if !on_edge(&p) => run.push(p),
                _ => runs.push(Vec::new()),
            }
        }
        runs.retain(|run| run.len() > 1);
        runs
    }
}
