//! How a robot moved between two scans, as its odometry has it.

use nalgebra::{Matrix3, Vector3};

use super::LocalizeError;
use crate::geometry::{Cov3, Pose, in_frame, turned_by, wrap_angle};

/// A motion in the frame of the scan before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    pub by: Pose,
    pub covariance: Cov3,
}

impl Motion {
    /// Where it leads to.
    pub fn from(&self, pose: &Pose) -> Pose {
        let there = in_frame(pose, &self.by);
        Pose { theta: wrap_angle(there.theta), ..there }
    }

    pub(super) fn information(&self, index: usize) -> Result<Cov3, LocalizeError> {
        self.covariance
            .try_inverse()
            .filter(|_| self.covariance.cholesky().is_some())
            .ok_or(LocalizeError::MotionCovariance(index))
    }
}

/// The poses that motions lead to.
pub(super) fn chain(first: Pose, motions: &[Motion]) -> Vec<Pose> {
    let mut poses = vec![first];
    for motion in motions {
        poses.push(motion.from(&poses[poses.len() - 1]));
    }
    poses
}

/// How far two poses are from a motion, and the derivatives by either.
pub(super) fn misfit(motion: &Motion, before: &Pose, after: &Pose) -> (Vector3<f64>, Matrix3<f64>, Matrix3<f64>) {
    let (sin, cos) = before.theta.sin_cos();
    let own = turned_by(-before.theta, after.position() - before.position());
    let turn = wrap_angle(after.theta - before.theta - motion.by.theta);
    let by_after = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0);
    let by_before = Matrix3::new(-cos, -sin, own.y, sin, -cos, -own.x, 0.0, 0.0, -1.0);
    (Vector3::new(own.x - motion.by.x, own.y - motion.by.y, turn), by_before, by_after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_motion_leads_where_it_says_and_its_derivatives_are_right(
            x in -5.0..5.0f64, y in -5.0..5.0f64, theta in -3.0..3.0f64,
            by in prop::array::uniform3(-0.9..0.9f64), to in prop::array::uniform3(-0.9..0.9f64),
        ) {
            let motion = Motion { by: Pose::new(by[0], by[1], by[2]), covariance: Cov3::identity() };
            let before = Pose::new(x, y, theta);
            prop_assert!(misfit(&motion, &before, &motion.from(&before)).0.norm() < 1e-12);
            let after = Pose::new(x + to[0], y + to[1], theta + to[2]);
            let (_, by_before, by_after) = misfit(&motion, &before, &after);
            let e = 1e-6;
            for k in 0..3 {
                let moved = |pose: &Pose, e: f64| {
                    let mut own = [pose.x, pose.y, pose.theta];
                    own[k] += e;
                    Pose::new(own[0], own[1], own[2])
                };
                let difference = |at: &dyn Fn(f64) -> Vector3<f64>| (at(e) - at(-e)) / (2.0 * e);
                let first = difference(&|e| misfit(&motion, &moved(&before, e), &after).0);
                let second = difference(&|e| misfit(&motion, &before, &moved(&after, e)).0);
                prop_assert!((first - by_before.column(k)).norm() < 1e-7);
                prop_assert!((second - by_after.column(k)).norm() < 1e-7);
            }
        }
    }
}
