//! Damped Newton with the exact Hessian.
//!
//! Each step solves `(H + mu D) p = -gradient` with the exact Hessian and [`Objective::damping`]'s `D`; `mu` rises
//! until the matrix is positive definite and falls while the quadratic model keeps its promises. Where even a large
//! `mu` does not help, the step comes from the convex stand-in of the Hessian, which always does. Along the step a
//! backtracking line search (cubic cost: one evaluation, far below a factorisation) replaces the re-factorisations that
//! a rejected step would need. Gauss-Newton would converge linearly here, because the Eikonal residuals at the cut
//! locus stay large; the exact Hessian is as sparse and makes the end quadratic.
//!
//! [`super::continuation`]'s stages, which are a way and not an end, take the stand-in at every step
//! ([`StoppingRule::curvature`]): then nothing is indefinite, and damping only keeps steps within reason.
//!
//! At the end the undamped exact Hessian is factorised once more: positive definite there, together with a vanishing
//! gradient, is the certificate of a minimum.

use std::ops::ControlFlow;

use super::bordered::{Bordered, System};
use super::loss::Curvature;
use super::objective::Objective;
use super::{FitError, Progress};
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
    /// Which Hessian the steps take.
    pub curvature: Curvature,
}

/// How a minimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Minimum {
    pub iterations: usize,
    pub factorisations: usize,
    pub objective: f64,
    /// The largest absolute entry of the gradient.
    pub gradient_norm: f64,
    pub relative_gradient: f64,
    /// Whether the exact Hessian at the end is positive definite.
    pub positive_definite: bool,
}

/// Damping below this is none.
const NO_DAMPING: f64 = 1e-7;
/// The damping a fit starts with: enough for the squared Eikonal loss to be convex.
const FIRST_DAMPING: f64 = 1.0;
/// Where the convex stand-in takes the steps, damping only keeps them within reason.
const CONVEX_DAMPING: f64 = 1e-4;
/// Damping from which the convex stand-in is used instead.
const CONVEX_FROM: f64 = 1e3;
/// By how much damping rises where the matrix is indefinite, falls after a good step, and by how much the memory of
/// damping that was too little fades a step. Tuned on 20 draws of experiment 1 for the fewest factorisations.
const RAISE: f64 = 4.0;
const LOWER: f64 = 0.1;
const FORGET: f64 = 0.5;
/// A chord's step may promise this many times what the one before did, and must keep this share of it: else the factor
/// no longer tells what lies ahead.
const CHORD_GROWTH: f64 = 4.0;
const CHORD_GAIN: f64 = 0.1;
/// A step shorter than this share of the Newton step is given up, and damping raised instead.
const SHORTEST_STEP: f64 = 1e-4;
/// A fit whose damping exceeds this cannot move: it has gone as far as rounding lets it.
const STUCK_FROM: f64 = 1e12;

/// A minimisation under way.
pub struct Newton<'a> {
    objective: &'a Objective,
    cholesky: &'a mut Cholesky,
    damper: StencilMatrix,
    damping: f64,
    /// Damping that was too little of late; it is forgotten by and by.
    refused: f64,
    minimum: Minimum,
    /// Gradient and exact Hessian where the minimisation stands.
    pub system: System,
}

impl<'a> Newton<'a> {
    /// `spent` is what earlier minimisations cost; it is counted on from there.
    pub fn new(objective: &'a Objective, cholesky: &'a mut Cholesky, spent: Minimum) -> Self {
        Self {
            damper: objective.damping(),
            damping: 0.0,
            refused: 0.0,
            minimum: spent,
            system: objective.system(),
            objective,
            cholesky,
        }
    }

    /// Minimises from `unknowns`, which hold the result. `self.system` then is the one there, with the rule's
    /// curvature, and the Cholesky factor that of its Hessian where [`Minimum::positive_definite`].
    pub fn minimise(
        &mut self,
        unknowns: &mut [f64],
        rule: &StoppingRule,
        observer: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
    ) -> Result<Minimum, FitError> {
        self.damping = match rule.curvature {
            Curvature::Exact => FIRST_DAMPING,
            Curvature::Convex => CONVEX_DAMPING,
        };
        self.minimum.objective = self.objective.assemble(unknowns, rule.curvature, &mut self.system);
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
            let out_of_steps = self.minimum.iterations >= rule.max_iterations || self.damping > STUCK_FROM;
            let stationary = self.minimum.relative_gradient <= rule.tolerance;
            if (out_of_steps || stationary) && !rule.certify {
                return Ok(self.minimum);
            }
            if out_of_steps || stationary {
                self.minimum.factorisations += 1;
                self.minimum.positive_definite = Bordered::factorise(&self.system, self.cholesky).is_ok();
                if out_of_steps || self.minimum.positive_definite {
                    return Ok(self.minimum);
                }
                self.damping = self.damping.max(FIRST_DAMPING);
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
        self.damping = match (length, kept) {
            (0.0, _) => (self.damping * 16.0).max(1e-3),
            (t, _) if t < 1.0 => (self.damping * (0.5 / t).clamp(1.0, 8.0)).max(1e-4),
            (_, kept) if kept > 0.6 => (self.damping * LOWER).max(self.refused * 1.5).min(self.damping),
            (_, kept) if kept < 0.25 => self.damping * 2.0,
            _ => self.damping,
        };
        self.refused *= FORGET;
        if self.damping < NO_DAMPING {
            self.damping = 0.0;
        }
        self.minimum.objective = self.objective.assemble(unknowns, rule.curvature, &mut self.system);
        if self.minimum.objective.is_finite() { Ok(()) } else { Err(FitError::NotFinite) }
    }

    /// Further steps with the factor at hand (Shamanskii's: a chord's slope in place of the tangent's), as long as they
    /// pay: a gradient and a solve cost a fraction of a Hessian and its factor. `slope` is that of the step before. The
    /// solves go unchecked: only a step that lowers the objective is taken.
    fn chords(&mut self, unknowns: &mut [f64], factor: &Bordered, most: usize, mut slope: f64) {
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
    fn factorise_damped(&mut self, unknowns: &[f64]) -> Result<Bordered, FitError> {
        let mut added = 0.0;
        let mut convex = false;
        loop {
            damp(&mut self.system, &self.damper, self.damping - added);
            added = self.damping;
            self.minimum.factorisations += 1;
            match Bordered::factorise(&self.system, self.cholesky) {
                Ok(factor) => return Ok(factor),
                Err(SparseError::NotPositiveDefinite) if self.damping < CONVEX_FROM => {
                    self.refused = self.damping;
                    self.damping = (self.damping * RAISE).max(1e-4);
                }
                Err(SparseError::NotPositiveDefinite) if !convex => {
                    self.objective.assemble(unknowns, Curvature::Convex, &mut self.system);
                    (added, convex) = (0.0, true);
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
    system.hessian.values.iter_mut().zip(&damper.values).for_each(|(h, d)| *h += amount * d);
    for block in &mut system.poses {
        (0..3).for_each(|k| block[(k, k)] += 2.0 * amount);
    }
}

/// The largest absolute value; infinite where one is not a number.
pub(super) fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |worst: f64, v| if v.is_nan() { f64::INFINITY } else { worst.max(v.abs()) })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
