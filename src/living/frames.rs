//! Frames: where one map's coordinates lie in another's.

use nalgebra::Matrix3;

use crate::geometry::{Cov3, Pose, Vec2};

/// `frame` after `pose`: a pose given in a frame, in the frame's own surroundings.
pub fn in_frame(frame: &Pose, pose: &Pose) -> Pose {
    let p = frame.position() + turned_by(frame.theta, pose.position());
    Pose::new(p.x, p.y, frame.theta + pose.theta)
}

/// The frame in which `frame`'s surroundings are given in its own coordinates.
pub fn inverse(frame: &Pose) -> Pose {
    let p = -turned_by(-frame.theta, frame.position());
    Pose::new(p.x, p.y, -frame.theta)
}

/// A pose's covariance as the frame's surroundings see it.
pub fn covariance_in_frame(frame: &Pose, covariance: &Cov3) -> Cov3 {
    let (sin, cos) = frame.theta.sin_cos();
    let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
    let own = turn * covariance * turn.transpose();
    (own + own.transpose()) * 0.5
}

/// A vector turned by an angle.
pub fn turned_by(angle: f64, v: Vec2) -> Vec2 {
    let (sin, cos) = angle.sin_cos();
    Vec2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
}
