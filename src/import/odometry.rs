//! The odometry motion model: how a pose's covariance grows along the way.
//!
//! A motion between two poses is a turn `r1`, a straight way `t` and a turn `r2`, with independent errors (Thrun,
//! Burgard, Fox, "Probabilistic Robotics", 5.4; the parameters are those of Nav2's AMCL):
//!
//! ```text
//! var r1 = alpha1 r1^2 + alpha2 t^2     var t = alpha3 t^2 + alpha4 (r1^2 + r2^2)     var r2 = alpha1 r2^2 + alpha2 t^2
//! C' = F C F^T + L diag(var r1, var t, var r2) L^T
//! ```
//!
//! It is for logs whose poses are wheel odometry. A job takes the poses' errors as independent of each other, which
//! those of odometry are not: a map of a long drive is better served by poses some SLAM has corrected, with a constant
//! noise.

use nalgebra::{Matrix3, Vector3};

use crate::geometry::{Cov3, Pose, wrap_angle};
use crate::scan::{LaserScan, Noise};

/// A way shorter than this is a turn on the spot, metres.
const ON_THE_SPOT: f64 = 1e-3;

/// The motion model's parameters `alpha1` to `alpha4`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Odometry {
    pub alphas: [f64; 4],
}

impl Odometry {
    /// Gives every scan its pose's covariance; the first one's is `noise`'s.
    pub fn spread(&self, scans: &mut [LaserScan], noise: &Noise) {
        let mut covariance = noise.pose_covariance();
        let mut before: Option<Pose> = None;
        for scan in scans {
            if let Some(before) = before {
                covariance = self.moved(&covariance, &before, &scan.pose);
            }
            scan.pose_covariance = Some(covariance);
            before = Some(scan.pose);
        }
    }

    /// The covariance after a motion.
    fn moved(&self, covariance: &Cov3, from: &Pose, to: &Pose) -> Cov3 {
        let way = to.position() - from.position();
        let t = way.norm();
        let first = if t > ON_THE_SPOT { wrap_angle(way.y.atan2(way.x) - from.theta) } else { 0.0 };
        let second = wrap_angle(to.theta - from.theta - first);
        // Driving backwards is no turn of half a circle, there and back.
        let turns = [first, second].map(|turn| turn.abs().min(std::f64::consts::PI - turn.abs()).powi(2));
        let [a1, a2, a3, a4] = self.alphas;
        let errors = Vector3::new(
            a1 * turns[0] + a2 * t * t,
            a3 * t * t + a4 * (turns[0] + turns[1]),
            a1 * turns[1] + a2 * t * t,
        );
        let (sin, cos) = (from.theta + first).sin_cos();
        let f = Matrix3::new(1.0, 0.0, -t * sin, 0.0, 1.0, t * cos, 0.0, 0.0, 1.0);
        let l = Matrix3::new(-t * sin, cos, 0.0, t * cos, sin, 0.0, 1.0, 0.0, 1.0);
        let grown = f * covariance * f.transpose() + l * Matrix3::from_diagonal(&errors) * l.transpose();
        (grown + grown.transpose()) * 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::psd_square_root;

    fn along(poses: &[Pose]) -> Vec<Cov3> {
        let scan = |pose: &Pose| LaserScan {
            pose: *pose,
            pose_covariance: None,
            sigma_range: None,
            frame: 0,
            angle_min: 0.0,
            angle_increment: 0.1,
            range_min: 0.1,
            range_max: 10.0,
            ranges: vec![1.0],
        };
        let mut scans: Vec<LaserScan> = poses.iter().map(scan).collect();
        let still = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range: 0.02 };
        Odometry { alphas: [0.04, 0.01, 0.02, 0.03] }.spread(&mut scans, &still);
        scans.into_iter().filter_map(|scan| scan.pose_covariance).collect()
    }

    #[test]
    fn a_straight_way_errs_by_its_length_and_sideways_by_its_heading() {
        let [first, second] = along(&[Pose::new(0.0, 0.0, 0.0), Pose::new(2.0, 0.0, 0.0)])[..] else { panic!() };
        assert_eq!(first, Cov3::zeros());
        assert!((second[(0, 0)] - 0.02 * 4.0).abs() < 1e-12, "along");
        assert!((second[(1, 1)] - 0.01 * 4.0 * 4.0).abs() < 1e-12, "across: the turn's variance times the way squared");
        assert!((second[(2, 2)] - 2.0 * 0.01 * 4.0).abs() < 1e-12);
    }

    #[test]
    fn backwards_is_as_good_as_forwards_and_a_turn_moves_nothing() {
        let back = along(&[Pose::new(0.0, 0.0, 0.0), Pose::new(-2.0, 0.0, 0.0)]);
        let forth = along(&[Pose::new(0.0, 0.0, 0.0), Pose::new(2.0, 0.0, 0.0)]);
        assert!((back[1].diagonal() - forth[1].diagonal()).norm() < 1e-12);
        let turned = along(&[Pose::new(0.0, 0.0, 0.0), Pose::new(0.0, 0.0, 1.0)]);
        assert!((turned[1][(2, 2)] - 0.04).abs() < 1e-12 && turned[1][(1, 1)] < 1e-12);
    }

    #[test]
    fn headings_get_worse_all_along_and_it_is_always_a_covariance() {
        let walk: Vec<Pose> =
            (0..50).map(|k| f64::from(k) * 0.3).map(|s| Pose::new(s.sin(), s.cos() * s, 0.7 * s)).collect();
        let grown = along(&walk);
        // The place may get better for a while: what a wrong heading led astray, driving back leads back.
        assert!(grown.windows(2).all(|pair| pair[1][(2, 2)] > pair[0][(2, 2)]));
        assert!(grown.iter().all(|covariance| psd_square_root(covariance).is_some()));
    }
}
