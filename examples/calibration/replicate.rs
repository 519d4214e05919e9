//! One draw of the noise, fitted and set against the truth.

use std::time::Instant;

use mapfit::fit::FitOptions;
use mapfit::geometry::{Pose, Vec2, wrap_angle};
use mapfit::map::Survey;
use mapfit::sim::Scenario;
use mapfit::uncertainty::Kind;

/// Where a scenario's maps are judged.
pub struct Truth {
    pub poses: Vec<Pose>,
    /// Points of the seen boundary.
    pub boundary: Vec<Vec2>,
    /// Which of them lie farther than a cell from every corner.
    pub plain: Vec<bool>,
    /// Points of seen free space, with their exact distance.
    pub inside: Vec<(Vec2, f64)>,
    /// Which of them lie farther than a cell from the cut locus.
    pub smooth: Vec<bool>,
}

impl Truth {
    pub fn of(scenario: &Scenario) -> Self {
        let (world, h) = (&scenario.world, scenario.resolution);
        let within =
            |p: &Vec2| (0..2).all(|axis| (scenario.bounds.min[axis]..=scenario.bounds.max[axis]).contains(&p[axis]));
        let boundary: Vec<Vec2> = scenario.seen_boundary(0.1).into_iter().filter(within).collect();
        let corners: Vec<Vec2> = world.corners().collect();
        let plain = boundary.iter().map(|p| corners.iter().all(|c| (c - p).norm() > h)).collect();
        let step = 0.2;
        let size = [0, 1].map(|axis| ((scenario.bounds.max[axis] - scenario.bounds.min[axis]) / step) as usize);
        let at = |k: usize| {
            let (i, j) = (k % size[0], k / size[0]);
            Vec2::new(scenario.bounds.min[0] + step * i as f64, scenario.bounds.min[1] + step * j as f64)
        };
        let seen = |p: &Vec2| {
            world.is_free(*p) && scenario.sees_point(*p) && scenario.sees_point(world.nearest(*p) * 0.999 + p * 0.001)
        };
        let inside: Vec<(Vec2, f64)> =
            (0..size[0] * size[1]).map(at).filter(seen).map(|p| (p, world.signed_distance(p))).collect();
        let smooth = inside.iter().map(|(p, _)| world.is_smooth(*p, h) && world.is_smooth(*p, h / 2.0)).collect();
        Self { poses: scenario.poses.clone(), boundary, plain, inside, smooth }
    }
}

/// What one fit got right and wrong.
pub struct Replicate {
    pub converged: bool,
    pub factorisations: usize,
    pub seconds: f64,
    /// (u, sigma) at [`Truth::boundary`].
    pub boundary: Vec<(f64, f64)>,
    /// (error, sigma) at [`Truth::inside`].
    pub inside: Vec<(f64, f64)>,
    /// (x, y, theta) errors of every pose: as reported, as fitted, and the fitted one's sigma.
    pub poses: Vec<[[f64; 3]; 3]>,
    /// The weights in use: `rho_e`, scale, smoothing.
    pub weights: [f64; 3],
}

pub fn replicate(scenario: &Scenario, truth: &Truth, options: &FitOptions, seed: u64) -> Replicate {
    let begun = Instant::now();
    let scans = scenario.scans(seed);
    let survey = Survey::new(&scans, scenario.noise).resolution(scenario.resolution).bounds(scenario.bounds);
    let map = survey.options(*options).map().expect("a map");
    let at = |p: Vec2| map.distance(p, Kind::Propagated).unwrap_or((f64::NAN, f64::NAN));
    let error = |pose: &Pose, truth: &Pose| [pose.x - truth.x, pose.y - truth.y, wrap_angle(pose.theta - truth.theta)];
    let poses = truth
        .poses
        .iter()
        .enumerate()
        .map(|(scan, own)| {
            let covariance = map.pose_covariance.propagated.get(scan);
            let sigma = std::array::from_fn(|a| covariance.map_or(f64::NAN, |c| c[(a, a)].max(0.0).sqrt()));
            [error(&scans[scan].pose, own), error(&map.poses[scan], own), sigma]
        })
        .collect();
    Replicate {
        converged: map.report.converged,
        factorisations: map.report.factorisations,
        seconds: begun.elapsed().as_secs_f64(),
        boundary: truth.boundary.iter().map(|&p| at(p)).collect(),
        inside: truth.inside.iter().map(|&(p, exact)| (at(p).0 - exact, at(p).1)).collect(),
        poses,
        weights: [
            map.report.weights.eikonal,
            map.report.weights.eikonal_scale.unwrap_or(f64::NAN),
            map.report.weights.smoothing,
        ],
    }
}
