//! Where on the map a scan may have been taken: correlative search (Olson 2009) over a raster of the distance.
//!
//! The raster holds how near the nearest surface is, and where a robot may stand. Every pose of a grid, positions where beams
//! passed and headings all around, is scored by how near the scan's returns come to surfaces; the best that are not each
//! other's neighbours are the starts for the descent. Where there is a prior the grid covers what it allows: its mean alone,
//! where it is sharper than the descent's basin.

use nalgebra::Vector3;

use super::{Prior, Sighted};
use crate::geometry::{Pose, Vec2, wrap_angle};
use crate::map::FittedMap;
use crate::uncertainty::Kind;

/// Cells of the raster at most, and their side at least, metres.
const MOST_CELLS: usize = 1_000_000;
const FINEST: f64 = 0.05;
/// Distances beyond this all score nothing, metres.
const FAR: f64 = 0.5;
/// Steps of the search, metres and radians, and poses of it at most; beams of the scan that are looked at.
const STEP: f64 = 0.3;
const TURN: f64 = std::f64::consts::TAU / 72.0;
const MOST_POSES: usize = 600_000;
const BEAMS: usize = 48;
/// Starts that are refined, of a search over the map and of one about a prior.
const MOST_STARTS: usize = 60;
const MOST_NEAR: usize = 16;
/// Starts are apart by so much, metres and radians.
const APART: (f64, f64) = (0.6, 0.3);
/// From within this a descent finds its minimum: metres, radians (half its measured basin).
const BASIN: (f64, f64) = (0.1, 0.05);
/// A prior is taken to hold within so many sigmas.
const SPAN: f64 = 2.5;

/// A map's raster for the search.
#[derive(Debug, Clone)]
pub struct Ground {
    origin: Vec2,
    step: f64,
    size: [usize; 2],
    /// How near a surface is: 1 at it, 0 at `FAR` and beyond.
    nearness: Vec<f32>,
    /// Whether beams passed, and no surface is there.
    free: Vec<bool>,
}

/// A pose and its score.
type Scored = (f64, Pose);

impl Ground {
    /// The raster of a map.
    pub fn of(map: &FittedMap) -> Self {
        let bounds = map.lattice().bounds();
        let [width, height] = bounds.size();
        let step = (width * height / MOST_CELLS as f64).sqrt().max(FINEST).max(0.5 * map.lattice().resolution);
        let size = [width, height].map(|span| (span / step).ceil().max(1.0) as usize);
        let mut own = Self {
            origin: Vec2::new(bounds.min[0], bounds.min[1]),
            step,
            size,
            nearness: Vec::with_capacity(size[0] * size[1]),
            free: Vec::with_capacity(size[0] * size[1]),
        };
        for k in 0..size[0] * size[1] {
            let p = own.place(k);
            let seen = map.evidence.at(map.lattice(), p);
            let distance = map.distance(p, Kind::Propagated).map(|(distance, _)| distance.abs());
            let near = distance.filter(|_| seen.any()).map_or(0.0, |distance| (1.0 - distance / FAR).max(0.0));
            own.nearness.push(near as f32);
            own.free.push(seen.any() && distance.is_some_and(|distance| distance > step));
        }
        own
    }

    /// Bytes it holds in memory.
    pub fn held_bytes(&self) -> usize {
        5 * self.nearness.len()
    }

    fn middle(&self) -> Pose {
        let at = self.origin + 0.5 * self.step * Vec2::new(self.size[0] as f64, self.size[1] as f64);
        Pose::new(at.x, at.y, 0.0)
    }

    fn place(&self, k: usize) -> Vec2 {
        let at = |n: usize| (n as f64 + 0.5) * self.step;
        self.origin + Vec2::new(at(k % self.size[0]), at(k / self.size[0]))
    }

    fn cell(&self, p: Vec2) -> Option<usize> {
        let at = (p - self.origin) / self.step;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        inside.then(|| at.x as usize + at.y as usize * self.size[0])
    }

    /// Starts for the descent, the best first; there is one at least.
    pub fn starts(&self, sighted: &Sighted) -> Vec<Pose> {
        let returns = returns(sighted);
        match &sighted.prior {
            None => {
                let best = self.best(self.everywhere(&returns), MOST_STARTS);
                // Where nothing is free there is nowhere to stand; the middle says as much.
                if best.is_empty() { vec![self.middle()] } else { best }
            }
            Some(prior) => {
                let sigma = Vector3::from_fn(|k, _| prior.covariance[(k, k)].max(0.0).sqrt());
                if sigma.xy().amax() <= BASIN.0 && sigma.z <= BASIN.1 {
                    return vec![prior.pose];
                }
                let mut starts = vec![prior.pose];
                starts.extend(self.best(self.about(prior, sigma, &returns), MOST_NEAR));
                starts
            }
        }
    }

    fn everywhere(&self, returns: &[Vec2]) -> Vec<Scored> {
        let headings = (std::f64::consts::TAU / TURN).round() as usize;
        let free = self.free.iter().filter(|free| **free).count();
        // Every so many cells, so that poses are no more than there may be.
        let usual = (STEP / self.step).round().max(1.0) as usize;
        let stride = (usual..).find(|n| free / (n * n) * headings <= MOST_POSES).unwrap_or(usual);
        let turned: Vec<(f64, Vec<Vec2>)> = (0..headings).map(|k| turn(returns, k as f64 * TURN)).collect();
        let rows = (0..self.size[1]).step_by(stride);
        let places = rows.flat_map(|j| (0..self.size[0]).step_by(stride).map(move |i| i + j * self.size[0]));
        let standing = places.filter(|k| self.free[*k]).map(|k| self.place(k));
        standing.flat_map(|at| turned.iter().map(move |(theta, points)| self.scored(at, *theta, points))).collect()
    }

    fn about(&self, prior: &Prior, sigma: Vector3<f64>, returns: &[Vec2]) -> Vec<Scored> {
        let turns = steps(sigma.z.min(std::f64::consts::PI / SPAN), TURN);
        let (across, along) = (steps(sigma.x, STEP), steps(sigma.y, STEP));
        // A grid too large for one prior is thinned along every axis alike.
        let all = across.len() * along.len() * turns.len();
        let thin = (all as f64 / MOST_POSES as f64).powf(1.0 / 3.0).ceil().max(1.0) as usize;
        let mut scored = Vec::new();
        for turn_by in turns.into_iter().step_by(thin) {
            let (theta, points) = turn(returns, wrap_angle(prior.pose.theta + turn_by));
            for dy in along.iter().step_by(thin) {
                for dx in across.iter().step_by(thin) {
                    scored.push(self.scored(prior.pose.position() + Vec2::new(*dx, *dy), theta, &points));
                }
            }
        }
        scored
    }

    fn scored(&self, at: Vec2, theta: f64, points: &[Vec2]) -> Scored {
        let near = |offset: &Vec2| self.cell(at + offset).map_or(0.0, |k| f64::from(self.nearness[k]));
        let sum: f64 = points.iter().map(near).sum();
        (sum / points.len().max(1) as f64, Pose::new(at.x, at.y, theta))
    }

    /// The best scored that are apart from each other.
    fn best(&self, mut scored: Vec<Scored>, most: usize) -> Vec<Pose> {
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Vec<Pose> = Vec::new();
        // Behind many neighbours of the best there may be others; far down there is nothing.
        for (_, pose) in scored.iter().take(MOST_POSES / 20) {
            let is_apart = |other: &Pose| {
                (other.position() - pose.position()).norm() > APART.0
                    || wrap_angle(other.theta - pose.theta).abs() > APART.1
            };
            if best.iter().all(is_apart) {
                best.push(*pose);
            }
            if best.len() == most {
                break;
            }
        }
        best
    }
}

/// A scan's returns as seen from it, a few of them spread all over it.
fn returns(sighted: &Sighted) -> Vec<Vec2> {
    let scan = &sighted.scan;
    let all = (0..scan.ranges.len()).filter_map(|k| {
        let (range, bearing) = (scan.range(k)?, scan.bearing(k));
        Some(Vec2::new(range * bearing.cos(), range * bearing.sin()))
    });
    let all: Vec<Vec2> = all.collect();
    let skip = all.len().div_ceil(BEAMS).max(1);
    all.into_iter().step_by(skip).collect()
}

fn turn(returns: &[Vec2], theta: f64) -> (f64, Vec<Vec2>) {
    let (sin, cos) = theta.sin_cos();
    (theta, returns.iter().map(|p| Vec2::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y)).collect())
}

/// Offsets within a span of sigmas, zero among them.
fn steps(sigma: f64, step: f64) -> Vec<f64> {
    let count = (SPAN * sigma / step).ceil().clamp(0.0, 400.0) as i32;
    (-count..=count).map(|k| f64::from(k) * step).collect()
}
