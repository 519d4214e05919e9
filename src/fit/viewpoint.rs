//! Where scans were taken from, and what their returns are worth.

use nalgebra::Vector3;

use super::FitError;
use crate::geometry::{Cov3, Pose, Vec2, psd_square_root};
use crate::scan::{LaserScan, Noise, Return, ReturnNoise, returns_of};
use crate::spline::Lattice;

/// One scan's pose as the objective needs it.
#[derive(Debug, Clone, PartialEq)]
pub struct Viewpoint {
    pub position: Vec2,
    /// `R`, the square root of the pose's covariance.
    pub root: Cov3,
    /// In which frame the pose was reported.
    pub frame: usize,
    pub noise: ReturnNoise,
}

impl Viewpoint {
    /// What the pose unknowns `e` of all scans, which are empty where poses are fixed, change of this one's (x, y,
    /// theta).
    pub fn correction(&self, scan: usize, e: &[f64]) -> Vector3<f64> {
        e.get(3 * scan..3 * scan + 3).map_or_else(Vector3::zeros, |own| self.root * Vector3::from_column_slice(own))
    }
}

/// The returns inside the lattice; that there is none is an error.
pub(super) fn returns_inside(scans: &[LaserScan], lattice: &Lattice) -> Result<Vec<Return>, FitError> {
    let returns: Vec<Return> =
        returns_of(scans).into_iter().filter(|seen| lattice.locate(seen.point).is_some()).collect();
    if returns.is_empty() { Err(FitError::NoEvidence) } else { Ok(returns) }
}

/// The median standard deviation of a return, its pose's share included, metres. The viewpoints' poses are as reported.
pub(super) fn scatter(returns: &[Return], viewpoints: &[Viewpoint]) -> f64 {
    let mut scatter: Vec<f64> = returns
        .iter()
        .map(|seen| viewpoints[seen.scan].noise.covariance(seen).symmetric_eigenvalues().max().max(0.0).sqrt())
        .collect();
    let middle = scatter.len() / 2;
    *scatter.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The standard deviation of a range, metres: where scans differ, the one with which as many returns know as much.
pub(super) fn range_sigma(scans: &[LaserScan], noise: &Noise, returns: &[Return]) -> f64 {
    let own = |seen: &Return| scans[seen.scan].sigma_range(noise);
    let first = returns.first().map_or(noise.sigma_range, own);
    if returns.iter().all(|seen| own(seen) == first) {
        return first;
    }
    let known: f64 = returns.iter().map(|seen| own(seen).powi(-2)).sum();
    (returns.len() as f64 / known).sqrt()
}

/// How many times over returns of such a sigma determine a cell of wall: returns an occupied cell x (h / sigma)^2.
pub(super) fn information(lattice: &Lattice, returns: &[Return], sigma: f64) -> f64 {
    let mut cells: Vec<usize> =
        returns.iter().filter_map(|seen| lattice.locate(seen.point)).map(|at| lattice.cell_index(at.cell)).collect();
    cells.sort_unstable();
    cells.dedup();
    let density = returns.len() as f64 / cells.len().max(1) as f64;
    density * (lattice.resolution / sigma).powi(2)
}

pub(super) fn viewpoints(scans: &[LaserScan], noise: &Noise, model_sigma: f64) -> Result<Vec<Viewpoint>, FitError> {
    scans
        .iter()
        .enumerate()
        .map(|(scan, laser)| {
            let covariance: Cov3 = laser.pose_covariance(noise);
            let root = psd_square_root(&covariance).ok_or(FitError::PoseCovariance { scan })?;
            let noise = ReturnNoise {
                pose: Some(covariance),
                range_variance: laser.sigma_range(noise).powi(2),
                model_variance: model_sigma.powi(2),
            };
            Ok(Viewpoint { position: laser.pose.position(), root, frame: laser.frame, noise })
        })
        .collect()
}

/// The poses for the pose unknowns `e`, which are empty where poses are fixed.
pub(super) fn corrected(scans: &[LaserScan], viewpoints: &[Viewpoint], e: &[f64]) -> Vec<Pose> {
    scans
        .iter()
        .enumerate()
        .map(|(scan, laser)| (laser.pose, viewpoints[scan].correction(scan, e)))
        .map(|(pose, change)| Pose::new(pose.x + change.x, pose.y + change.y, pose.theta + change.z))
        .collect()
}

/// The pose unknowns for poses: those from which a fit makes the same poses again.
pub fn pose_unknowns(scans: &[LaserScan], noise: &Noise, poses: &[Pose]) -> Result<Vec<f64>, FitError> {
    let viewpoints = viewpoints(scans, noise, 0.0)?;
    let own = |((scan, pose), viewpoint): ((&LaserScan, &Pose), &Viewpoint)| {
        let moved = Vector3::new(pose.x - scan.pose.x, pose.y - scan.pose.y, pose.theta - scan.pose.theta);
        // A coordinate that is exactly known has not moved.
        let inverse = viewpoint.root.pseudo_inverse(1e-12).unwrap_or_else(|_| Cov3::zeros());
        <[f64; 3]>::from(inverse * moved)
    };
    Ok(scans.iter().zip(poses).zip(&viewpoints).flat_map(own).collect())
}

/// Maps numbers linearly onto [1, 2]; all to 1 where they are the same.
pub(super) fn onto_one_to_two(raw: Vec<f64>) -> Vec<f64> {
    let low = raw.iter().copied().fold(f64::INFINITY, f64::min);
    let spread = raw.iter().copied().fold(0.0, f64::max) - low;
    raw.iter().map(|raw| if spread > 0.0 { 1.0 + (raw - low) / spread } else { 1.0 }).collect()
}
