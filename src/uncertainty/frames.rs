//! Where joined frames lie after a fit, and how well that is known.
//!
//! A frame's motion is a linear function of its scans' pose unknowns, `f = S U_f^T e` (`fit::gauge`). Its error has two
//! parts: what the fit makes of the inputs' noise, and the noise of the reports themselves, since a frame is what they were
//! reported in:
//!
//! ```text
//! f - true f = A^T (M^-1 N - 1) d + A^T M^-1 B w        A = U_f S^T
//! ```
//!
//! with `d` the reports' noise, `N` their mixed derivatives and `B w` the other inputs'. `A` takes three solves.

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use super::UncertaintyError;
use super::marginals::for_each_carried;
use crate::fit::gauge::LOOSE;
use crate::fit::{Estimate, Factor};
use crate::geometry::{Cov3, Vec2};

/// How a joined frame moved from where its scans were put.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameShift {
    pub frame: usize,
    /// What it turned about, metres.
    pub center: Vec2,
    /// In (x, y, theta).
    pub motion: Vector3<f64>,
    pub covariance: Cov3,
}

/// The shift of every frame but the first. There are none where there is one frame.
pub fn frame_shifts(estimate: &mut Estimate) -> Result<Vec<FrameShift>, UncertaintyError> {
    if estimate.system.gauge.frames.is_empty() {
        return Ok(Vec::new());
    }
    let factor = Factor::factorise(&estimate.system, &mut estimate.cholesky)?;
    let answer = factor.answer_to_common_motion().ok_or(UncertaintyError::NoMinimum)?;
    let unknowns = 3 * estimate.viewpoints.len();
    let e = &estimate.resume[estimate.resume.len().saturating_sub(unknowns)..];
    let along = estimate.system.gauge.along(e);
    let mut shifts = Vec::new();
    for own in &estimate.system.gauge.frames {
        let motion = own.scale * Vector3::from_fn(|k, _| along[own.first + k]);
        let covariance = covariance(estimate, &factor, &answer, (own.first, &own.scale))?;
        shifts.push(FrameShift { frame: own.frame, center: own.center, motion, covariance });
    }
    Ok(shifts)
}

fn covariance(
    estimate: &Estimate,
    factor: &Factor,
    answer: &Mat<f64>,
    (first_column, scale): (usize, &Matrix3<f64>),
) -> Result<Cov3, UncertaintyError> {
    let (motions, pattern) = (&estimate.system.gauge, estimate.system.hessian.pattern());
    let (first, n) = (pattern.coefficients(), pattern.dimension());
    let told = Mat::from_fn(n, 3, |row, k| match row.checked_sub(first) {
        Some(pose) => (0..3).map(|m| motions.columns[(pose, first_column + m)] * scale[(k, m)]).sum::<f64>(),
        None => 0.0,
    });
    let mut x = told.clone();
    factor.solve_block(&estimate.cholesky, x.as_mut())?;
    let mut covariance = Cov3::zeros();
    let (points, row) = (pattern.stencil().dimension(), pattern.stencil().size()[0]);
    for_each_carried(estimate, &mut |input| {
        let mut share = Vector3::zeros();
        for (component, own) in input.by_control_points[..pattern.components()].iter().enumerate() {
            for (k, own) in own.iter().enumerate() {
                let at = component * points + input.first + k % 4 + k / 4 * row;
                (0..3).for_each(|column| share[column] += own * x[(at, column)]);
            }
        }
        for (pose, own) in input.by_poses {
            (0..9).for_each(|k| share[k % 3] += own[k / 3] * x[(first + 3 * pose + k / 3, k % 3)]);
        }
        covariance += share * share.transpose();
    });
    let reports: Vec<Vec<f64>> = (0..3)
        .map(|column| {
            let own: Vec<f64> = (first..n).map(|row| x[(row, column)]).collect();
            let mut y: Vec<f64> =
                own.iter().enumerate().map(|(k, x)| estimate.prior() * x - told[(first + k, column)]).collect();
            for (mode, (at_x, at_y)) in motions.along(&own).iter().zip(motions.along(&y)).enumerate() {
                // Along the gauge the answer to a common motion tells; along a loose frame the prior holds little.
                let change = match mode < motions.held {
                    true => (0..n).map(|row| answer[(row, mode)] * told[(row, column)]).sum::<f64>() - at_y,
                    false => -estimate.prior() * LOOSE * at_x,
                };
                y.iter_mut().enumerate().for_each(|(row, y)| *y += change * motions.columns[(row, mode)]);
            }
            y
        })
        .collect();
    covariance += Cov3::from_fn(|a, b| reports[a].iter().zip(&reports[b]).map(|(a, b)| a * b).sum());
    Ok((covariance + covariance.transpose()) * 0.5)
}
