//! Returns in the world, with what noise in range and pose does to them.
//!
//! `X = p + r d`, `d = (cos(theta + b), sin(theta + b))`. Its derivative with respect to the range is `d`, with respect
//! to (x, y, theta) `[I | r d_perp]`. (The method's paper prints `theta - b`; every real log needs `theta + b`.) The
//! covariance that follows depends on whether the pose is known: see [`super::ReturnNoise`].

use nalgebra::SMatrix;

use super::laser::LaserScan;
use crate::geometry::{Vec2, projection_by_pose};

/// A beam that met a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Return {
    /// The index of its scan among the job's.
    pub scan: usize,
    pub beam: usize,
    /// Where the surface was met, metres in the map's frame.
    pub point: Vec2,
    /// The unit vector along the beam: the point's derivative with respect to the range.
    pub direction: Vec2,
    pub range: f64,
}

impl Return {
    /// The point's derivative with respect to its scan's (x, y, theta).
    pub fn by_pose(&self) -> SMatrix<f64, 2, 3> {
        projection_by_pose(self.direction * self.range)
    }
}

/// Every return of the scans, in the order of scans and beams.
pub fn returns_of(scans: &[LaserScan]) -> Vec<Return> {
    scans
        .iter()
        .enumerate()
        .flat_map(|(index, scan)| {
            (0..scan.ranges.len()).filter_map(move |beam| {
                let range = scan.range(beam)?;
                let direction = scan.pose.direction(scan.bearing(beam));
                let point = scan.pose.position() + direction * range;
                Some(Return { scan: index, beam, point, direction, range })
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use proptest::prelude::*;

    fn seen(x: f64, y: f64, theta: f64, range: f64) -> Return {
        let scan = LaserScan {
            pose: Pose::new(x, y, theta),
            pose_covariance: None,
            sigma_range: None,
            frame: 0,
            angle_min: 0.3,
            angle_increment: 0.1,
            range_min: 0.05,
            range_max: 30.0,
            ranges: vec![f64::NAN, range],
        };
        returns_of(&[scan])[0]
    }

    proptest! {
        #[test]
        fn derivatives_agree_with_central_differences(
            x in -5.0..5.0f64, y in -5.0..5.0f64, theta in -4.0..4.0f64, range in 0.1..20.0f64,
        ) {
            let e = 1e-6;
            let at = seen(x, y, theta, range);
            let slope = |ahead: Return, behind: Return| (ahead.point - behind.point) / (2.0 * e);
            let by_range = slope(seen(x, y, theta, range + e), seen(x, y, theta, range - e));
            let by_x = slope(seen(x + e, y, theta, range), seen(x - e, y, theta, range));
            let by_theta = slope(seen(x, y, theta + e, range), seen(x, y, theta - e, range));
            prop_assert!((by_range - at.direction).norm() < 1e-7);
            prop_assert!((by_x - at.by_pose().column(0)).norm() < 1e-7);
            prop_assert!((by_theta - at.by_pose().column(2)).norm() < 1e-7);
        }
    }

    #[test]
    fn beams_without_a_return_are_left_out() {
        let at = seen(0.0, 0.0, 0.0, 2.0);
        assert_eq!((at.scan, at.beam), (0, 1));
        assert!((at.point - Vec2::new(2.0 * 0.4f64.cos(), 2.0 * 0.4f64.sin())).norm() < 1e-15);
    }
}
