//! A vector map against the building it was made of.

use crate::geometry::{Bounds, Vec2};
use crate::map::FittedMap;
use crate::render::{OccupancyGrid, Trinary};
use crate::scan::returns_of;
use crate::sim::Survey;
use crate::uncertainty::Kind;

/// A wall is seen where a true return lies this near, metres.
const SEEN_WITHIN: f64 = 0.15;
/// Space is judged this near to a wall, metres, on a grid this fine.
const NEAR: f64 = 1.0;
const GRID: f64 = 0.2;
/// Cells farther from any wall than this are open, metres.
const OPEN: f64 = 0.5;
/// An error that is far, and what the coverage of distances grants, metres.
const FAR: f64 = 0.3;
const SLACK: f64 = 0.005;
/// A cell's number from which a wall in it counts as found.
const FOUND_FROM: i8 = 45;

/// Where a map is judged.
pub struct Truth<'a> {
    survey: &'a Survey,
    /// Points of seen walls, with the wall's normal; 0.1 m apart.
    pub walls: Vec<(Vec2, Vec2)>,
    /// Points of seen space within 1 m of a seen wall, farther than a cell from the cut locus, with the nearest wall
    /// point.
    pub space: Vec<(Vec2, Vec2)>,
    /// Points of all seen space whose nearest wall point was met, however near to the cut locus, with the distance.
    pub everywhere: Vec<(Vec2, f64)>,
    hits: Vec<Vec2>,
}

/// How far a map is off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// Length of the vector on seen walls, rms, metres.
    pub walls: f64,
    /// Error of the vector's length in seen space, mean, metres.
    pub space: f64,
    /// Share of the seen wall points whose normal component lies within two sigma.
    pub coverage: f64,
}

/// How far a map's distance is off, and how well its sigma knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceJudgement {
    pub points: usize,
    /// Mean error, metres.
    pub mean: f64,
    /// Mean signed error, metres.
    pub bias: f64,
    /// Share of the points that are off by more than 0.3 m.
    pub far: f64,
    /// Share within two sigma and 5 mm.
    pub coverage: f64,
    /// Share of the points whose clearance exceeds the true one by more than three sigma.
    pub reckless: f64,
}

/// An occupancy grid against the walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridJudgement {
    pub occupied: usize,
    pub precision: f64,
    /// Share of the seen wall points that lie in or beside a cell that is not free.
    pub recall: f64,
    /// Open cells, and how many of them are occupied all the same.
    pub open: usize,
    pub phantoms: usize,
}

impl<'a> Truth<'a> {
    /// `resolution` is the map's spacing of control points, metres.
    pub fn of(survey: &'a Survey, resolution: f64) -> Self {
        let hits: Vec<Vec2> = returns_of(&survey.scans).iter().map(|seen| seen.point).collect();
        let met = |p: Vec2| hits.iter().any(|hit| (hit - p).norm() < SEEN_WITHIN);
        let plan = &survey.plan;
        let view = |p: Vec2| plan.in_view(&survey.lidar, &survey.poses, p);
        let walls = plan.boundary(0.1).into_iter().filter(|(p, _)| met(*p) && view(*p)).collect();
        let area = Bounds::around(hits.iter().copied()).unwrap_or(Bounds { min: [0.0; 2], max: [0.0; 2] });
        let [width, height] = area.size().map(|side| (side / GRID) as usize);
        let space = (0..width * height)
            .map(|k| Vec2::from(area.min) + Vec2::new((k % width) as f64, (k / width) as f64) * GRID)
            .map(|p| (p, plan.nearest(p)))
            .filter(|(p, q)| (p - q).norm() < NEAR && met(*q) && view(*p) && plan.is_smooth(*p, resolution))
            .collect();
        let everywhere = (0..width * height)
            .map(|k| Vec2::from(area.min) + Vec2::new((k % width) as f64, (k / width) as f64) * GRID)
            .map(|p| (p, plan.nearest(p)))
            .filter(|(p, q)| view(*p) && met(*q))
            .map(|(p, q)| (p, (p - q).norm()))
            // Where something was met that is much nearer, the plan lacks a wall.
            .filter(|(p, truth)| !hits.iter().any(|hit| (hit - p).norm() < truth - SEEN_WITHIN))
            .collect();
        Self { survey, walls, space, everywhere, hits }
    }

    pub fn judge(&self, map: &FittedMap) -> Judgement {
        let vector = |p: Vec2| map.field.vector(p).map(|at| at.vector);
        let squares = mean(self.walls.iter().filter_map(|(p, _)| vector(*p)).map(|v| v.norm_squared()));
        let errors = self.space.iter().filter_map(|(p, q)| Some((vector(*p)?.norm() - (p - q).norm()).abs()));
        let covered = self.walls.iter().filter_map(|(p, normal)| {
            let [xx, xy, yy] = map.field.vector_covariance(*p, Kind::Propagated)?;
            let sigma = (normal.x * normal.x * xx + 2.0 * normal.x * normal.y * xy + normal.y * normal.y * yy).sqrt();
            Some(f64::from(vector(*p)?.dot(normal).abs() <= 2.0 * sigma))
        });
        Judgement { walls: squares.sqrt(), space: mean(errors), coverage: mean(covered) }
    }

    /// The distance in all seen space.
    pub fn judge_distance(&self, map: &FittedMap) -> DistanceJudgement {
        let free = |p: Vec2| map.evidence.at(map.lattice(), p).free;
        judge_points(map, self.everywhere.iter().copied().filter(|(p, _)| free(*p)))
    }

    /// The distance where the scanner stood.
    pub fn judge_poses(&self, map: &FittedMap) -> DistanceJudgement {
        let places = self.survey.poses.iter().map(|pose| pose.position());
        judge_points(map, places.map(|p| (p, (self.survey.plan.nearest(p) - p).norm())))
    }

    /// Judges a grid. What some return met is no phantom: a survey's file may leave out walls its scanner saw.
    pub fn judge_grid(&self, map: &FittedMap, grid: &OccupancyGrid) -> GridJudgement {
        let half = grid.resolution / 2.0;
        let center = |k: usize| {
            let at = |n: usize, axis: usize| grid.origin[axis] + (n as f64 + 0.5) * grid.resolution;
            Vec2::new(at(k % grid.width, 0), at(k / grid.width, 1))
        };
        let met = |p: Vec2| self.hits.iter().any(|hit| (hit - p).norm() < grid.resolution);
        let (mut occupied, mut right, mut open, mut phantoms) = (0, 0, 0, 0);
        for (k, &cell) in grid.data.iter().enumerate().filter(|(_, cell)| **cell >= 0) {
            let p = center(k);
            let distance = (self.survey.plan.nearest(p) - p).norm();
            let is_occupied = Trinary::of(cell) == Trinary::Occupied;
            let is_open = distance > OPEN && !met(p);
            if is_occupied && (distance <= OPEN || is_open) {
                occupied += 1;
                right += usize::from(distance <= half * 1.5);
            }
            if is_open && map.evidence.at(map.lattice(), p).free {
                open += 1;
                phantoms += usize::from(is_occupied);
            }
        }
        let recall = mean(self.walls.iter().map(|(p, _)| {
            let mut near = (0..grid.data.len()).filter(|&k| (center(k) - p).amax() <= half * 1.2);
            f64::from(near.any(|k| grid.data[k] >= FOUND_FROM))
        }));
        GridJudgement { occupied, precision: right as f64 / f64::max(1.0, occupied as f64), recall, open, phantoms }
    }

    /// Whether a point is farther than `reach` from every wall, and no return met anything within a cell there.
    pub fn is_off(&self, p: Vec2, reach: f64) -> bool {
        (self.survey.plan.nearest(p) - p).norm() > reach && !self.hits.iter().any(|hit| (hit - p).norm() < 2.0 * reach)
    }
}

/// What a map says at a point, and the truth.
struct Asked {
    distance: f64,
    sigma: f64,
    clearance: f64,
    truth: f64,
}

fn judge_points(map: &FittedMap, points: impl Iterator<Item = (Vec2, f64)>) -> DistanceJudgement {
    let asked: Vec<Asked> = points
        .filter_map(|(p, truth)| {
            let (distance, sigma) = map.distance(p, Kind::Propagated)?;
            Some(Asked { distance, sigma, clearance: map.clearance(p)?, truth })
        })
        .collect();
    let share = |of: &dyn Fn(&Asked) -> bool| mean(asked.iter().map(|own| f64::from(of(own))));
    let error = |own: &Asked| own.distance - own.truth;
    DistanceJudgement {
        points: asked.len(),
        mean: mean(asked.iter().map(|own| error(own).abs())),
        bias: mean(asked.iter().map(error)),
        far: share(&|own| error(own).abs() > FAR),
        coverage: share(&|own| error(own).abs() <= 2.0 * own.sigma + SLACK),
        reckless: share(&|own| own.clearance - own.truth > 3.0 * own.sigma),
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / f64::max(n, 1.0)
}
