//! Points, poses and small covariances in the plane.
//!
//! The frame is right-handed with x forward and angles counter-clockwise. A return at bearing `b` and range `r` seen
//! from pose `(x, y, theta)` lies at `(x + r cos(theta + b), y + r sin(theta + b))`.

use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2};
use serde::{Deserialize, Serialize};

/// A point or a vector of the plane, metres.
pub type Vec2 = Vector2<f64>;
/// A covariance of a point, square metres.
pub type Cov2 = Matrix2<f64>;
/// A covariance of a pose in (x, y, theta): metres and radians.
pub type Cov3 = Matrix3<f64>;

/// Where a sensor was and which way it looked: metres, radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
pub struct Pose {
    pub x: f64,
    pub y: f64,
    pub theta: f64,
}

impl Pose {
    pub fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta }
    }

    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x, self.y)
    }

    /// The unit vector towards a bearing measured from the pose's heading.
    pub fn direction(&self, bearing: f64) -> Vec2 {
        let (sin, cos) = (self.theta + bearing).sin_cos();
        Vec2::new(cos, sin)
    }

    /// The point at a range and bearing from the pose.
    pub fn project(&self, range: f64, bearing: f64) -> Vec2 {
        self.position() + self.direction(bearing) * range
    }
}

/// The derivative of a projected point with respect to (x, y, theta).
pub fn projection_by_pose(offset: Vec2) -> SMatrix<f64, 2, 3> {
    SMatrix::<f64, 2, 3>::new(1.0, 0.0, -offset.y, 0.0, 1.0, offset.x)
}

/// An axis-aligned rectangle, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    pub min: [f64; 2],
    pub max: [f64; 2],
}

impl Bounds {
    /// The smallest rectangle around the points, or `None` where there are none.
    pub fn around(points: impl IntoIterator<Item = Vec2>) -> Option<Self> {
        points.into_iter().fold(None, |bounds: Option<Self>, p| {
            Some(match bounds {
                None => Self { min: [p.x, p.y], max: [p.x, p.y] },
                Some(b) => {
                    Self { min: [b.min[0].min(p.x), b.min[1].min(p.y)], max: [b.max[0].max(p.x), b.max[1].max(p.y)] }
                }
            })
        })
    }

    /// The rectangle with every side moved outwards by `margin`.
    pub fn grown(&self, margin: f64) -> Self {
        Self { min: [self.min[0] - margin, self.min[1] - margin], max: [self.max[0] + margin, self.max[1] + margin] }
    }

    pub fn contains(&self, p: Vec2) -> bool {
        p.x >= self.min[0] && p.x <= self.max[0] && p.y >= self.min[1] && p.y <= self.max[1]
    }

    pub fn size(&self) -> [f64; 2] {
        [self.max[0] - self.min[0], self.max[1] - self.min[1]]
    }
}

/// The quarter turn of a vector, counter-clockwise.
pub fn turned(v: Vec2) -> Vec2 {
    Vec2::new(-v.y, v.x)
}

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

/// How far along the segment `a b` its point nearest to `p` lies: 0 at `a`, 1 at `b`.
pub fn share_on_segment(p: Vec2, a: Vec2, b: Vec2) -> f64 {
    let ab = b - a;
    let length2 = ab.norm_squared();
    if length2 > 0.0 { ((p - a).dot(&ab) / length2).clamp(0.0, 1.0) } else { 0.0 }
}

/// The point of the segment `a b` nearest to `p`.
pub fn nearest_on_segment(p: Vec2, a: Vec2, b: Vec2) -> Vec2 {
    a + (b - a) * share_on_segment(p, a, b)
}

/// The distance of a point from the segment `a b`.
pub fn distance_to_segment(p: Vec2, a: Vec2, b: Vec2) -> f64 {
    (p - nearest_on_segment(p, a, b)).norm()
}

/// An angle brought into (-pi, pi].
pub fn wrap_angle(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let wrapped = angle.rem_euclid(turn);
    if wrapped > std::f64::consts::PI { wrapped - turn } else { wrapped }
}

/// A square root `R` of a positive semi-definite matrix, `R R^T = C`, or `None` where `C` is not one.
///
/// A Cholesky decomposition would refuse the singular covariances that an exactly known coordinate gives, so this
/// one goes through the eigenvalues. Eigenvalues above `-1e-12` of the largest count as zero.
pub fn psd_square_root(c: &Cov3) -> Option<Cov3> {
    if !c.iter().all(|v| v.is_finite()) || c.diagonal().iter().any(|v| *v < 0.0) {
        return None;
    }
    let scale = c.diagonal().amax();
    let eigen = c.symmetric_eigen();
    let slack = -1e-12 * scale.max(eigen.eigenvalues.amax());
    if eigen.eigenvalues.iter().any(|&value| value < slack) {
        return None;
    }
    let roots = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
    Some(eigen.eigenvectors * Cov3::from_diagonal(&roots))
}
