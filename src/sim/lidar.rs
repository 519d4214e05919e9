//! A planar laser scanner with noise on its ranges and on the pose it believes in.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::geometry::{Pose, Vec2};
use crate::scan::{LaserScan, Noise};

/// A scanner: `beams` beams spread evenly over `field_of_view` radians, the middle one straight ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lidar {
    pub beams: usize,
    pub field_of_view: f64,
    pub range_min: f64,
    pub range_max: f64,
}

impl Lidar {
    /// Beams over a field of view given in degrees, seeing from 5 cm to 30 m.
    pub fn of_degrees(beams: usize, degrees: f64) -> Self {
        Self { beams, field_of_view: degrees.to_radians(), range_min: 0.05, range_max: 30.0 }
    }

    pub fn angle_increment(&self) -> f64 {
        if self.beams > 1 { self.field_of_view / (self.beams - 1) as f64 } else { 0.0 }
    }

    pub fn angle_min(&self) -> f64 {
        if self.beams > 1 { -self.field_of_view / 2.0 } else { 0.0 }
    }
}

/// What a beam can meet.
pub trait Scene {
    /// How far the nearest wall is along a unit direction.
    fn cast(&self, from: Vec2, direction: Vec2) -> Option<f64>;
}

/// One scan per true pose. The scan carries the noisy pose; ranges are measured from the true one.
pub fn simulate(scene: &impl Scene, lidar: &Lidar, poses: &[Pose], noise: &Noise, seed: u64) -> Vec<LaserScan> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = |sigma: f64| {
        let z: f64 = StandardNormal.sample(&mut rng);
        sigma * z
    };
    poses
        .iter()
        .map(|pose| {
            let ranges = (0..lidar.beams)
                .map(|beam| {
                    let bearing = lidar.angle_min() + beam as f64 * lidar.angle_increment();
                    let error = normal(noise.sigma_range);
                    match scene.cast(pose.position(), pose.direction(bearing)) {
                        Some(range) if range <= lidar.range_max => range + error,
                        _ => f64::NAN,
                    }
                })
                .collect();
            LaserScan {
                pose: Pose::new(
                    pose.x + normal(noise.sigma_x),
                    pose.y + normal(noise.sigma_y),
                    pose.theta + normal(noise.sigma_theta),
                ),
                pose_covariance: None,
                sigma_range: None,
                frame: 0,
                angle_min: lidar.angle_min(),
                angle_increment: lidar.angle_increment(),
                range_min: lidar.range_min,
                range_max: lidar.range_max,
                ranges,
            }
        })
        .collect()
}

/// Scans with noise drawn upon their poses.
pub fn misplaced(scans: &[LaserScan], noise: &Noise, seed: u64) -> Vec<LaserScan> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = |sigma: f64| {
        let z: f64 = StandardNormal.sample(&mut rng);
        sigma * z
    };
    let moved = |scan: &LaserScan| {
        let pose = scan.pose;
        let pose = Pose::new(
            pose.x + normal(noise.sigma_x),
            pose.y + normal(noise.sigma_y),
            pose.theta + normal(noise.sigma_theta),
        );
        LaserScan { pose, ..scan.clone() }
    };
    scans.iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::returns_of;
    use crate::sim::World;

    #[test]
    fn without_noise_every_return_lies_on_a_wall() {
        let (world, lidar) = (World::l_room(), Lidar::of_degrees(271, 270.0));
        let still = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range: 0.0 };
        let scans = simulate(&world, &lidar, &[Pose::new(1.5, 1.5, 0.785)], &still, 0);
        let returns = returns_of(&scans);
        assert_eq!(returns.len(), 271);
        assert!(returns.iter().all(|r| world.signed_distance(r.point).abs() < 1e-9));
    }

    #[test]
    fn one_seed_is_one_log_and_another_seed_another() {
        let draw = |seed| {
            let poses = [Pose::new(1.5, 1.5, 0.785)];
            simulate(&World::l_room(), &Lidar::of_degrees(181, 180.0), &poses, &Noise::EXPERIMENT_ONE, seed)
        };
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7), draw(8));
    }
}
