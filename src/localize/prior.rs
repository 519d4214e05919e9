//! What is known of a pose before its scan is looked at.

use nalgebra::Vector3;

use crate::geometry::{Cov3, Pose, wrap_angle};

/// Eigenvalues of a covariance below this, m^2 or rad^2, are taken for it: nobody knows a pose to a micrometre.
const SHARPEST: f64 = 1e-12;

/// A pose as reported, and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    pub pose: Pose,
    pub covariance: Cov3,
    information: Cov3,
}

impl Prior {
    /// `covariance` must be symmetric; what is exactly known is taken as known to a micrometre.
    pub fn new(pose: Pose, covariance: Cov3) -> Self {
        let eigen = (0.5 * (covariance + covariance.transpose())).symmetric_eigen();
        let inverse = eigen.eigenvalues.map(|value| 1.0 / value.max(SHARPEST));
        let information = eigen.eigenvectors * Cov3::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
        Self { pose, covariance, information }
    }

    /// Its inverse covariance.
    pub fn information(&self) -> &Cov3 {
        &self.information
    }

    /// How far a pose lies from it: (x, y, theta), the angle in (-pi, pi].
    pub fn offset(&self, pose: &Pose) -> Vector3<f64> {
        let turn = wrap_angle(pose.theta - self.pose.theta);
        Vector3::new(pose.x - self.pose.x, pose.y - self.pose.y, turn)
    }

    /// `(q - q0)^T P^-1 (q - q0)`.
    pub fn cost(&self, pose: &Pose) -> f64 {
        let offset = self.offset(pose);
        offset.dot(&(self.information * offset))
    }
}
