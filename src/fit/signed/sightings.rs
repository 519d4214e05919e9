//! The returns as the objective sees them: where they lie for given poses, on the lattice, sorted by cell.
//!
//! A refined pose is `q = q0 + R e`: `q0` the pose as reported, `R R^T` its covariance, `e` three unknowns whose prior
//! is standard normal. So an exactly known coordinate (a singular covariance) needs no special case, and all unknowns
//! of all scans have one scale.

use std::borrow::Cow;
use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::loss::{Curvature, LocalJet};
use super::sampson::{frozen, sampson};
use crate::fit::gauge::Motions;
use crate::fit::viewpoint::{Viewpoint, onto_one_to_two};
use crate::geometry::Vec2;
use crate::scan::Return;
use crate::sparse::Views;
use crate::spline::{Lattice, Located, Surface};

/// A return where the current poses put it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    pub located: Located,
    pub seen: Return,
    /// Which of [`Sightings::returns`] this is.
    pub source: usize,
}

/// How a return's distance is weighed.
#[derive(Debug, Clone, PartialEq)]
pub enum Weighing {
    /// `rho_o u^2`, one constant a return: the published form.
    Frozen(Vec<f64>),
    /// Sampson's distance.
    Sampson,
}

/// The returns of a job inside a lattice.
#[derive(Debug, Clone)]
pub struct Sightings {
    pub returns: Vec<Return>,
    pub viewpoints: Vec<Viewpoint>,
    pub weighing: Weighing,
    pub refined: bool,
    /// `U`, the directions the gauge holds (see `fit::gauge`); without columns where poses are fixed.
    pub gauge: Motions,
    reported: Placed,
}

/// Sightings grouped by cell.
#[derive(Debug, Clone, Default)]
pub struct Placed {
    sorted: Vec<Sighting>,
    /// Where each occupied cell's run starts: (cell index, first sighting).
    runs: Vec<(usize, usize)>,
}

impl Sightings {
    /// Sightings from poses as reported. `returns` are those inside the lattice.
    pub fn new(lattice: &Lattice, returns: Vec<Return>, viewpoints: Vec<Viewpoint>, weighing: Weighing) -> Self {
        let (gauge, reported) = (Motions::none(0), Placed::default());
        let mut sightings = Self { returns, viewpoints, weighing, refined: false, gauge, reported };
        sightings.reported = sightings.place(lattice, &vec![0.0; 3 * sightings.viewpoints.len()]);
        sightings
    }

    /// Makes the poses unknowns, or takes them as reported. Returns of an unknown pose have the ranges' noise alone:
    /// the pose's is then modelled where it belongs.
    pub fn refine(&mut self, refined: bool) {
        self.refined = refined;
        self.gauge = if refined { Motions::of(&self.viewpoints) } else { Motions::none(0) };
        for viewpoint in &mut self.viewpoints {
            viewpoint.noise.pose = (!refined).then(|| viewpoint.root * viewpoint.root.transpose());
        }
    }

    /// What every pose sees, as reported.
    pub fn views(&self, lattice: &Lattice) -> Views {
        let cells: BTreeSet<(usize, [usize; 2])> =
            self.reported.iter().map(|sighting| (sighting.seen.scan, sighting.located.cell)).collect();
        let points = |(scan, cell): (usize, [usize; 2])| lattice.support(cell).map(|point| (scan, point));
        Views::of(self.viewpoints.len(), cells.into_iter().flat_map(points))
    }

    /// The number of pose unknowns.
    pub fn pose_unknowns(&self) -> usize {
        if self.refined { 3 * self.viewpoints.len() } else { 0 }
    }

    /// The sightings for the pose unknowns `e`, which are empty where poses are fixed.
    pub fn at(&self, lattice: &Lattice, e: &[f64]) -> Cow<'_, Placed> {
        if self.refined { Cow::Owned(self.place(lattice, e)) } else { Cow::Borrowed(&self.reported) }
    }

    /// The loss of one sighting in `(u, g_x, g_y, theta, r)`.
    pub fn loss(&self, sighting: &Sighting, u: f64, g: Vec2, curvature: Curvature) -> LocalJet<5> {
        match &self.weighing {
            Weighing::Frozen(weights) => frozen(u, weights[sighting.source]),
            Weighing::Sampson => {
                let noise = &self.viewpoints[sighting.seen.scan].noise;
                sampson(u, g, &noise.jet(&sighting.seen), curvature)
            }
        }
    }

    fn place(&self, lattice: &Lattice, e: &[f64]) -> Placed {
        let corrections: Vec<_> =
            self.viewpoints.iter().enumerate().map(|(scan, own)| own.correction(scan, e)).collect();
        let mut sorted: Vec<Sighting> = self
            .returns
            .iter()
            .enumerate()
            .map(|(source, seen)| {
                let change = corrections[seen.scan];
                let mut seen = *seen;
                if change != Vector3::zeros() {
                    let (sin, cos) = change.z.sin_cos();
                    let d = seen.direction;
                    seen.direction = Vec2::new(cos * d.x - sin * d.y, sin * d.x + cos * d.y);
                    seen.point = self.viewpoints[seen.scan].position + change.xy() + seen.direction * seen.range;
                }
                Sighting { located: lattice.locate_or_extend(seen.point), seen, source }
            })
            .collect();
        sorted.sort_by_key(|s| lattice.cell_index(s.located.cell));
        let mut runs: Vec<(usize, usize)> = Vec::new();
        for (k, sighting) in sorted.iter().enumerate() {
            let cell = lattice.cell_index(sighting.located.cell);
            if runs.last().is_none_or(|&(last, _)| last != cell) {
                runs.push((cell, k));
            }
        }
        Placed { sorted, runs }
    }
}

impl Placed {
    /// Every sighting, by cell.
    pub fn iter(&self) -> impl Iterator<Item = &Sighting> {
        self.sorted.iter()
    }

    /// The occupied cells with their sightings.
    pub fn by_cell<'a>(&'a self, lattice: &'a Lattice) -> impl Iterator<Item = ([usize; 2], &'a [Sighting])> + 'a {
        let nx = lattice.cells[0];
        self.runs.iter().enumerate().map(move |(k, &(cell, first))| {
            let end = self.runs.get(k + 1).map_or(self.sorted.len(), |&(_, next)| next);
            ([cell % nx, cell / nx], &self.sorted[first..end])
        })
    }
}

/// The published weights: `1 / (g cov g^T)` with `g` the start's unit gradient, mapped linearly onto [1, 2].
pub fn published_weights(returns: &[Return], viewpoints: &[Viewpoint], start: &Surface) -> Vec<f64> {
    let information = |seen: &Return| {
        let g = start.jet_at(&start.lattice.locate_or_extend(seen.point)).gradient;
        let direction = g.try_normalize(1e-12).unwrap_or(seen.direction);
        1.0 / direction.dot(&(viewpoints[seen.scan].noise.covariance(seen) * direction)).max(f64::MIN_POSITIVE)
    };
    onto_one_to_two(returns.iter().map(information).collect())
}
