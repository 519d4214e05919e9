//! A world, a scanner, where it stood and how noisy it was: everything that defines a simulated job.

use super::lidar::{Lidar, simulate};
use super::world::World;
use crate::geometry::{Bounds, Pose, Vec2};
use crate::scan::{LaserScan, Noise};

#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    pub world: World,
    pub lidar: Lidar,
    /// The true poses.
    pub poses: Vec<Pose>,
    pub noise: Noise,
    /// The area to map.
    pub bounds: Bounds,
    /// The spacing of control points, metres.
    pub resolution: f64,
}

impl Scenario {
    /// The method's experiment 1: the L-shaped room, three poses, 181 beams over 180 degrees, h = 0.2 m.
    pub fn experiment_one() -> Self {
        let world = World::l_room();
        let quarter = std::f64::consts::FRAC_PI_2;
        let bounds = world.bounds().grown(0.6);
        Self {
            world,
            lidar: Lidar::of_degrees(181, 180.0),
            poses: vec![
                Pose::new(1.5, 1.5, quarter / 2.0),
                Pose::new(6.0, 2.0, quarter + 0.6),
                Pose::new(2.0, 6.0, -0.3),
            ],
            noise: Noise::EXPERIMENT_ONE,
            bounds,
            resolution: 0.2,
        }
    }

    /// Experiment 1's scanner, noise and resolution in another world.
    pub fn like_experiment_one(world: World, poses: &[[f64; 3]]) -> Self {
        let bounds = world.bounds().grown(0.6);
        let poses = poses.iter().map(|&[x, y, theta]| Pose::new(x, y, theta)).collect();
        Self { world, poses, bounds, ..Self::experiment_one() }
    }

    /// The U-shaped room from three poses.
    pub fn u_room() -> Self {
        Self::like_experiment_one(World::u_room(), &[[4.0, 0.7, 1.57], [1.4, 6.8, -1.4], [6.7, 6.6, -1.8]])
    }

    /// The T-shaped room from four poses.
    pub fn t_room() -> Self {
        Self::like_experiment_one(
            World::t_room(),
            &[[4.4, 2.2, -1.5], [1.2, 6.9, -0.3], [7.9, 6.7, -2.8], [4.6, 6.0, 1.8]],
        )
    }

    /// The hall with three pillars from five poses.
    pub fn pillar_room() -> Self {
        let poses = [[1.0, 1.0, 0.8], [8.1, 0.9, 2.3], [7.9, 6.2, -2.4], [1.1, 6.0, -0.8], [4.4, 1.0, 1.6]];
        Self::like_experiment_one(World::pillar_room(), &poses)
    }

    /// An office like a comb with `side` metres, scanned all around every 6 m: for measuring how cost grows.
    pub fn comb_office(side: f64) -> Self {
        let world = World::comb_office(side);
        let reach = world.bounds().max;
        let mut poses = Vec::new();
        let rooms = ((reach[0] + 1.0) / 4.0).round() as usize;
        for room in 0..rooms {
            let x = 4.0 * room as f64 + 1.5;
            let mut y = 1.5;
            while y < reach[1] - 1.0 {
                poses.push([x, y, 0.3 + 0.1 * room as f64]);
                y += 6.0;
            }
        }
        let wide = Lidar::of_degrees(271, 270.0);
        Self { lidar: wide, ..Self::like_experiment_one(world, &poses) }
    }

    /// The scans of one draw of the noise.
    pub fn scans(&self, seed: u64) -> Vec<LaserScan> {
        simulate(&self.world, &self.lidar, &self.poses, &self.noise, seed)
    }

    /// Points of the true boundary that some true pose could see, `step` metres apart.
    pub fn seen_boundary(&self, step: f64) -> Vec<Vec2> {
        let mut points = self.world.boundary(step);
        points.retain(|&p| self.sees_point(p));
        points
    }

    /// Whether some true pose has a point in view.
    pub fn sees_point(&self, p: Vec2) -> bool {
        self.poses.iter().any(|pose| self.sees(pose, p))
    }

    fn sees(&self, pose: &Pose, p: Vec2) -> bool {
        let offset = p - pose.position();
        let bearing = crate::geometry::wrap_angle(offset.y.atan2(offset.x) - pose.theta);
        bearing.abs() <= self.lidar.field_of_view / 2.0
            && offset.norm() <= self.lidar.range_max
            && self.world.sees(pose.position(), p)
    }
}
