//! A planar laser scan, as `sensor_msgs/LaserScan` has it, with the pose it was taken from.

use crate::geometry::{Cov3, Pose};

/// One scan: beam `k` has bearing `angle_min + k angle_increment` from the pose's heading.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserScan {
    pub pose: Pose,
    /// The pose's own covariance in (x, y, theta); it replaces the pose part of [`Noise`].
    pub pose_covariance: Option<Cov3>,
    /// The standard deviation of its own ranges, metres; it replaces that of [`Noise`]. Scans of several requests are
    /// fitted together.
    pub sigma_range: Option<f64>,
    /// In which frame the pose was reported; the scans of one share its error. 0 but of maps that are joined.
    pub frame: usize,
    pub angle_min: f64,
    pub angle_increment: f64,
    pub range_min: f64,
    pub range_max: f64,
    /// Metres; NaN is no return.
    pub ranges: Vec<f64>,
}

impl LaserScan {
    pub fn bearing(&self, beam: usize) -> f64 {
        self.angle_min + beam as f64 * self.angle_increment
    }

    /// The range of a beam that met a surface: a range outside `[range_min, range_max]` is no return.
    pub fn range(&self, beam: usize) -> Option<f64> {
        let range = *self.ranges.get(beam)?;
        (range >= self.range_min && range <= self.range_max).then_some(range)
    }

    /// The covariance of the scan's pose.
    pub fn pose_covariance(&self, noise: &Noise) -> Cov3 {
        self.pose_covariance.unwrap_or_else(|| noise.pose_covariance())
    }

    /// The standard deviation of the scan's ranges, metres.
    pub fn sigma_range(&self, noise: &Noise) -> f64 {
        self.sigma_range.unwrap_or(noise.sigma_range)
    }

    /// The same scan with a noise of its own, whatever it is fitted with.
    pub fn with_noise(mut self, noise: &Noise) -> Self {
        self.pose_covariance = Some(self.pose_covariance(noise));
        self.sigma_range = Some(self.sigma_range(noise));
        self
    }
}

/// The standard deviations of the input: metres, and radians for `theta`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    pub sigma_x: f64,
    pub sigma_y: f64,
    pub sigma_theta: f64,
    pub sigma_range: f64,
}

impl Noise {
    /// The noise of the method's experiment 1.
    pub const EXPERIMENT_ONE: Self = Self { sigma_x: 0.01, sigma_y: 0.01, sigma_theta: 0.005, sigma_range: 0.02 };

    /// That of its experiment 2.
    pub const EXPERIMENT_TWO: Self = Self { sigma_x: 0.05, sigma_y: 0.05, sigma_theta: 0.005, sigma_range: 0.02 };

    pub fn pose_covariance(&self) -> Cov3 {
        let variances = [self.sigma_x.powi(2), self.sigma_y.powi(2), self.sigma_theta.powi(2)];
        Cov3::from_diagonal(&variances.into())
    }
}
