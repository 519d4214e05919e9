//! Courses weighed against each other: distinct poses with probabilities.
//!
//! A course's evidence is its likelihood, integrated over its basin (Laplace): the product of its returns' densities, each a
//! mixture of what the map says and of anything in range, times what prior and motions say, times the square root of
//! `det(2 pi Lambda^-1)`. Returns of one cell of wall say much the same, so the product is taken to the power of how many
//! cells were met over how many returns met them. Courses that do not hold have no share: that a
//! scan was taken nowhere on the map is said by its fitting nowhere, not by a probability.

use std::collections::BTreeSet;

use super::Sighted;
use super::descent::{Agreement, Course};
use super::motion::{Motion, misfit};
use crate::geometry::{Pose, wrap_angle};
use crate::map::FittedMap;

/// The share of returns that meet what is not on the map.
const STRANGERS: f64 = 0.1;
/// Poses this near are the same: metres, radians.
const SAME: (f64, f64) = (0.1, 0.05);
/// Hypotheses less probable than this are none.
const LEAST: f64 = 1e-6;

/// Where a scan may have been taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis {
    pub pose: Pose,
    /// Among all that were found.
    pub probability: f64,
}

/// A course and its probability among all that were found.
pub type Ranked = (Course, f64);

/// Distinct courses that hold, the most probable first; the best that does not, alone, where none holds.
pub fn ranked(map: &FittedMap, scans: &[Sighted], motions: &[Motion], courses: Vec<Course>) -> Vec<Ranked> {
    let mut weighed: Vec<(f64, Course)> =
        courses.into_iter().map(|course| (log_evidence(map, scans, motions, &course), course)).collect();
    weighed.sort_by(|a, b| b.1.holds().cmp(&a.1.holds()).then(b.0.total_cmp(&a.0)));
    let mut distinct: Vec<(f64, Course)> = Vec::new();
    for (evidence, course) in weighed {
        let is_new = distinct.iter().all(|(_, other)| !is_same(&other.poses[0], &course.poses[0]));
        if is_new && (course.holds() || distinct.is_empty()) {
            distinct.push((evidence, course));
        }
    }
    let best = distinct.first().map_or(0.0, |own| own.0);
    let sum: f64 = distinct.iter().map(|own| (own.0 - best).exp()).sum();
    let share = |(evidence, course): (f64, Course)| (course, (evidence - best).exp() / sum);
    let mut ranked: Vec<Ranked> = distinct.into_iter().map(share).collect();
    let probable = ranked.iter().skip(1).take_while(|(_, probability)| *probability > LEAST).count();
    ranked.truncate(1 + probable);
    ranked
}

/// Whether two poses are the same hypothesis.
pub fn is_same(a: &Pose, b: &Pose) -> bool {
    (a.position() - b.position()).norm() < SAME.0 && wrap_angle(a.theta - b.theta).abs() < SAME.1
}

fn log_evidence(map: &FittedMap, scans: &[Sighted], motions: &[Motion], course: &Course) -> f64 {
    let returns: f64 = course.fits.iter().zip(scans).map(|(fit, sighted)| log_likelihood(map, fit, sighted)).sum();
    let priors: f64 = scans.iter().zip(&course.poses).filter_map(|(own, pose)| Some(own.prior?.cost(pose))).sum();
    let motions: f64 = motions
        .iter()
        .zip(course.poses.windows(2))
        .filter_map(|(motion, pair)| {
            let (off, ..) = misfit(motion, &pair[0], &pair[1]);
            Some(off.dot(&(motion.covariance.try_inverse()? * off)))
        })
        .sum();
    let volume = course.information.clone().cholesky().map_or(f64::NEG_INFINITY, |factor| {
        factor.l_dirty().diagonal().iter().map(|l| (std::f64::consts::TAU.sqrt() / l).ln()).sum()
    });
    returns - 0.5 * (priors + motions) + volume
}

fn log_likelihood(map: &FittedMap, fit: &Agreement, sighted: &Sighted) -> f64 {
    let anything = STRANGERS / sighted.scan.range_max.clamp(1.0, 100.0);
    let cells: BTreeSet<usize> = fit
        .used
        .iter()
        .filter_map(|used| map.field.locate(used.sighting.place))
        .map(|at| map.lattice().cell_index(at.cell))
        .collect();
    let resolution = map.lattice().resolution;
    let met: f64 = fit
        .used
        .iter()
        .map(|used| {
            let variance = fit.excess.max(1.0) * used.sighting.variance(sighted.sigma_range, resolution);
            let density =
                (-0.5 * used.sighting.residual.powi(2) / variance).exp() / (std::f64::consts::TAU * variance).sqrt();
            ((1.0 - STRANGERS) * density + anything).ln()
        })
        .sum();
    let strange = fit.left_out as f64 * anything.ln();
    let tempered = cells.len() as f64 / fit.used.len().max(1) as f64;
    tempered * (met + strange)
}
