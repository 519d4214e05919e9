//! Damped Newton with the exact Hessian.
//!
//! Each step solves `M p = -gradient` with `M` the Hessian as [`super::damping`] makes it positive definite; damping
//! rises until it is, and falls while the quadratic model keeps its promises. Along the step a backtracking line search
//! (cubic cost: one evaluation, far below a factorisation) replaces the re-factorisations that a rejected step would
//! need. Gauss-Newton would converge linearly here, because the Eikonal residuals at the cut locus stay large; the
//! exact Hessian is as sparse and makes the end quadratic.
//!
//! At the end the undamped exact Hessian is factorised once more: positive definite there, together with a vanishing
//! gradient, is the certificate of a minimum.

use nalgebra::Matrix3;

use super::damping::{Damping, Law};
use super::loss::Curvature;
use super::objective::Objective;
use crate::fit::estimate::Minimum;
use crate::fit::system::{Factor, System};
use crate::fit::{FitError, Observer, Progress};
use crate::sparse::{Cholesky, SparseError, StencilMatrix};

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoppingRule {
    pub max_iterations: usize,
    /// The gradient's largest entry over the start's at which the fit counts as stationary.
    pub tolerance: f64,
    /// The start's gradient's largest entry, where the minimisation begins elsewhere.
    pub first_gradient: Option<f64>,
    /// Whether a stationary point with an indefinite Hessian is left again.
    pub certify: bool,
    /// How many further steps one factorisation may serve.
    pub chords: usize,
    /// How steps are damped.
    pub law: Law,
}

/// A chord's step may promise this many times what the one before did, and must keep this share of it: else the factor
/// no longer tells what lies ahead.
const CHORD_GROWTH: f64 = 4.0;
const CHORD_GAIN: f64 = 0.1;
/// A step shorter than this share of the Newton step is given up, and damping raised instead.
const SHORTEST_STEP: f64 = 1e-4;

/// A minimisation under way.
pub struct Newton<'a> {
    objective: &'a Objective,
    cholesky: &'a mut Cholesky,
    damper: StencilMatrix,
    damping: Damping,
    minimum: Minimum,
    /// Gradient and Hessian where the minimisation stands; see [`Self::minimise`] for which Hessian.
    pub system: System,
}

impl<'a> Newton<'a> {
    /// `spent` is what earlier minimisations cost; it is counted on from there.
    pub fn new(objective: &'a Objective, cholesky: &'a mut Cholesky, spent: Minimum) -> Self {
        Self {
            damper: objective.damping(),
            damping: Damping::new(Law::Slopes),
            minimum: spent,
            system: objective.system(&vec![0.0; objective.sightings.pose_unknowns()]),
            objective,
            cholesky,
        }
    }

    /// Minimises from `unknowns`, which hold the result. `self.system` then is the one there (exact where the
    /// rule certifies), and the Cholesky factor that of its Hessian where [`Minimum::positive_definite`].
    pub fn minimise(
        &mut self,
        unknowns: &mut [f64],
        rule: &StoppingRule,
        observer: Observer<'_>,
    ) -> Result<Minimum, FitError> {
        self.damping = Damping::new(rule.law);
        self.minimum.objective = self.objective.assemble(unknowns, self.damping.curvature(), &mut self.system);
        let first = rule.first_gradient.unwrap_or_else(|| largest(&self.system.gradient));
        if !(self.minimum.objective.is_finite() && first.is_finite()) {
            return Err(FitError::NotFinite);
        }
        loop {
            self.minimum.gradient_norm = largest(&self.system.gradient);
            self.minimum.relative_gradient = if first > 0.0 { self.minimum.gradient_norm / first } else { 0.0 };
            let progress = Progress {
                iteration: self.minimum.iterations,
                max_iterations: rule.max_iterations,
                objective: self.minimum.objective,
                relative_gradient: self.minimum.relative_gradient,
            };
            if observer(&progress).is_break() {
                return Err(FitError::Cancelled);
            }
            let out_of_steps = self.minimum.iterations >= rule.max_iterations || self.damping.is_stuck();
            let stationary = self.minimum.relative_gradient <= rule.tolerance;
            if (out_of_steps || stationary) && !rule.certify {
                return Ok(self.minimum);
            }
            if out_of_steps || stationary {
                self.minimum.factorisations += 1;
                if self.damping.curvature() != Curvature::EXACT {
                    self.objective.assemble(unknowns, Curvature::EXACT, &mut self.system);
                }
                self.minimum.positive_definite = Factor::factorise(&self.system, self.cholesky).is_ok();
                if out_of_steps || self.minimum.positive_definite {
                    return Ok(self.minimum);
                }
                self.damping.restart();
                self.objective.assemble(unknowns, self.damping.curvature(), &mut self.system);
            }
            self.step(unknowns, rule)?;
        }
    }

    fn step(&mut self, unknowns: &mut [f64], rule: &StoppingRule) -> Result<(), FitError> {
        self.minimum.iterations += 1;
        let factor = self.factorise_damped(unknowns)?;
        let downhill: Vec<f64> = self.system.gradient.iter().map(|g| -g).collect();
        let step = factor.solve_checked(&self.system, self.cholesky, &downhill)?;
        let slope = -dot(&downhill, &step);
        let curved = dot(&self.system.times(&step), &step);
        let (length, kept) = self.search(unknowns, &step, slope, curved);
        for (x, s) in unknowns.iter_mut().zip(&step) {
            *x += length * s;
        }
        if length == 1.0 {
            self.chords(unknowns, &factor, rule.chords, slope);
        }
        self.damping.learn(length, kept);
        self.minimum.objective = self.objective.assemble(unknowns, self.damping.curvature(), &mut self.system);
        if self.minimum.objective.is_finite() { Ok(()) } else { Err(FitError::NotFinite) }
    }

    /// Further steps with the factor at hand (Shamanskii's: a chord's slope in place of the tangent's), as long as they
    /// pay: a gradient and a solve cost a fraction of a Hessian and its factor. `slope` is that of the step before. The
    /// solves go unchecked: only a step that lowers the objective is taken.
    fn chords(&mut self, unknowns: &mut [f64], factor: &Factor, most: usize, mut slope: f64) {
        for _ in 0..most {
            let mut step: Vec<f64> = self.objective.gradient(unknowns).iter().map(|g| -g).collect();
            let downhill = step.clone();
            factor.solve(self.cholesky, &mut step);
            let own = -dot(&downhill, &step);
            if !(own < 0.0 && own > CHORD_GROWTH * slope) {
                return;
            }
            let here = self.objective.value(unknowns);
            let trial: Vec<f64> = unknowns.iter().zip(&step).map(|(x, s)| x + s).collect();
            if here - self.objective.value(&trial) < -CHORD_GAIN * own {
                return;
            }
            unknowns.copy_from_slice(&trial);
            slope = own;
        }
    }

    /// Raises the damping until the system, which is damped in place, is positive definite.
    fn factorise_damped(&mut self, unknowns: &[f64]) -> Result<Factor, FitError> {
        let mut added = 0.0;
        loop {
            damp(&mut self.system, &self.damper, self.damping.slopes() - added);
            added = self.damping.slopes();
            self.minimum.factorisations += 1;
            match Factor::factorise(&self.system, self.cholesky) {
                Ok(factor) => return Ok(factor),
                Err(SparseError::NotPositiveDefinite) if !self.damping.is_stuck() => {
                    let before = self.damping.curvature();
                    self.damping.raise();
                    if self.damping.curvature() != before {
                        self.objective.assemble(unknowns, self.damping.curvature(), &mut self.system);
                        added = 0.0;
                    }
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// A step length that lowers the objective, and the share of the model's promise it kept; 0 where there is none.
    fn search(&self, unknowns: &[f64], step: &[f64], slope: f64, curved: f64) -> (f64, f64) {
        let rounding = 1e-13 * self.minimum.objective.abs();
        let mut t = 1.0;
        while t >= SHORTEST_STEP {
            let trial: Vec<f64> = unknowns.iter().zip(step).map(|(x, s)| x + t * s).collect();
            let promised = -t * (slope + 0.5 * t * curved);
            let fallen = self.minimum.objective - self.objective.value(&trial);
            if promised.abs() <= 100.0 * rounding && fallen.abs() <= 100.0 * rounding {
                return (t, 1.0);
            }
            if fallen >= 0.01 * promised {
                return (t, fallen / promised);
            }
            let parabola = -slope * t * t / (2.0 * (-fallen - slope * t));
            t = if parabola.is_finite() { parabola.clamp(0.1 * t, 0.5 * t) } else { 0.1 * t };
        }
        (0.0, 0.0)
    }
}

/// Adds `amount` of damping: to the lattice's part with the damper, to the poses' with their prior.
fn damp(system: &mut System, damper: &StencilMatrix, amount: f64) {
    if amount == 0.0 {
        return;
    }
    system.hessian.add_diagonal_block(0, &damper.values, amount);
    for pose in 0..system.hessian.pattern().views().poses() {
        system.hessian.add_pose(pose, &(Matrix3::identity() * (2.0 * amount)));
    }
}

/// The largest absolute value; infinite where one is not a number.
pub(in crate::fit) fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |worst: f64, v| if v.is_nan() { f64::INFINITY } else { worst.max(v.abs()) })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
