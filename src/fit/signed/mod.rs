//! The fit of a signed distance surface.
//!
//! Gathers evidence, leaves out what beams of other scans passed through, makes a start (`start`), sets up the
//! objective (`objective`) with resolved weights and minimises it (`newton`) in stages (`continuation`).

mod chain;
mod continuation;
mod damping;
mod eikonal;
mod inputs;
mod loss;
mod newton;
mod objective;
mod sampson;
mod sightings;
mod start;

pub use damping::Law;
pub use eikonal::EikonalLoss;
pub use loss::{Curvature, LocalJet};
pub(super) use newton::largest;
pub use newton::{Newton, StoppingRule};
pub use objective::Objective;
pub use sightings::{Placed, Sighting, Sightings, Weighing};
pub use start::{least_squares, signed_nearest_return};

use super::estimate::{Distance, Estimate, Minimum, missed_by};
use super::options::{FitOptions, Poses, Weighting, Weights};
use super::surfels::{Surfels, normals, standing};
use super::system::{Factor, System};
use super::viewpoint::{Viewpoint, corrected, information, returns_inside, scatter, viewpoints};
use super::{FitError, Job, Observer, Progress, in_use, why_not};
use crate::geometry::{Pose, Vec2};
use crate::scan::{Evidence, Return};
use crate::sparse::{Cholesky, Stencil};
use inputs::SignedInputs;

/// `calibrated` asks for unit slope where there is evidence, and this many cells around it. Farther off, nothing says
/// which of the many distance functions is the true one; the surface is continued smoothly, and a fit of a half-seen
/// place converges.
const EIKONAL_BAND: f64 = 1.0;

/// Steps a factorisation serves after its own under the squared loss, whose Hessian changes slowly along its valleys.
const CHORDS: usize = 1;

/// Fits a signed distance.
pub(super) fn fit(job: &Job<'_>, observer: Observer<'_>) -> Result<Estimate, FitError> {
    let &Job { scans, noise, lattice, options, .. } = job;
    let returns = returns_inside(scans, lattice)?;
    let mut viewpoints = viewpoints(scans, noise, 0.0)?;
    let scatter = scatter(&returns, &viewpoints);
    let weights = Weights::resolve(options, lattice.resolution, information(lattice, &returns, scatter));
    viewpoints.iter_mut().for_each(|own| own.noise.model_variance = weights.model_sigma.powi(2));
    let mut evidence = job.evidence(observer)?;
    let calibrated = options.weighting == Weighting::Calibrated;
    let observed = returns.len();
    let returns = match calibrated {
        true => what_stands(job, returns, &viewpoints, &mut evidence, observer)?,
        false => returns,
    };
    let seen_through = calibrated.then(|| 1.0 - returns.len() as f64 / observed as f64);
    let stencil = match options.band {
        Some(band) => Stencil::of_cells(lattice, &evidence.cells_within(lattice, band)),
        None => Stencil::of(lattice),
    };
    let mut cholesky = job.cholesky(&stencil)?;
    let severity = if calibrated { continuation::severity(scatter, lattice.resolution) } else { 0.0 };
    // An end that is found again has no use for a start, but for weights that were frozen there.
    let start = match job.end {
        Some(_) if calibrated => None,
        _ => Some(signed_nearest_return(lattice, &returns, &evidence, severity, &mut cholesky)?),
    };
    let weighing = match &start {
        Some(start) if !calibrated => Weighing::Frozen(sightings::published_weights(&returns, &viewpoints, start)),
        _ => Weighing::Sampson,
    };
    let sightings = Sightings::new(lattice, returns, viewpoints, weighing);
    sightings.views(lattice).check_size(1)?;
    let loss = eikonal_loss(&weights, options.weighting, lattice.resolution);
    let cells = calibrated.then(|| evidence.cells_within(lattice, EIKONAL_BAND));
    let points = if calibrated { 3 } else { 2 };
    let mut objective =
        Objective::new(lattice.clone(), stencil.clone(), sightings, loss, weights.smoothing, cells, points);

    let mut unknowns = start.map(|start| start.coefficients).unwrap_or_default();
    let (minimum, mut system) = match (job.ended(0), job.end) {
        (Some(coefficients), Some(end)) => {
            unknowns = coefficients;
            unknowns.extend(end.poses);
            at_the_end(&mut objective, &mut cholesky, &unknowns, (loss, &weights), end.positive_definite)
        }
        (None, Some(_)) => return Err(FitError::NotFinite),
        (_, None) => {
            let mut descent =
                Descent { objective: &mut objective, cholesky: &mut cholesky, weights: &weights, options };
            descent.run(&mut unknowns, loss, severity, observer)?
        }
    };
    if !minimum.positive_definite {
        stand_in(&objective, &unknowns, &mut system);
    }
    if weights.poses == Poses::Fixed {
        system = inputs::with_held_poses(&objective, &unknowns, &system);
    }
    let (c, e) = unknowns.split_at(lattice.len());
    let viewpoints = objective.sightings.viewpoints.clone();
    let surfaces = vec![in_use(lattice, &stencil, c.to_vec())];
    let returns = places(&objective, e);
    let converged = minimum.relative_gradient <= options.tolerance && minimum.positive_definite;
    Ok(Estimate {
        distance: Distance::Signed,
        weighting: options.weighting,
        lattice: lattice.clone(),
        rms: missed_by(&surfaces, returns.iter().copied()),
        surfaces,
        evidence,
        converged,
        unconverged: why_not(converged, &minimum, options),
        resume: e.to_vec(),
        minimum,
        weights,
        system,
        cholesky,
        poses: corrected(scans, &viewpoints, e),
        viewpoints,
        returns,
        inputs: Box::new(SignedInputs { objective, unknowns, weighting: options.weighting }),
        surfels: None,
        seen_through,
        cut_locus: None,
    })
}

/// Value and system where a fit ended before.
fn at_the_end(
    objective: &mut Objective,
    cholesky: &mut Cholesky,
    unknowns: &[f64],
    (loss, weights): (EikonalLoss, &Weights),
    known: Option<bool>,
) -> (Minimum, System) {
    objective.reweigh(loss, weights.smoothing, weights.poses == Poses::Refined);
    let e = &unknowns[objective.lattice.len()..];
    let mut system = objective.system(e);
    let value = objective.assemble(unknowns, Curvature::EXACT, &mut system);
    let gradient_norm = largest(&system.gradient);
    let positive_definite = known.unwrap_or_else(|| Factor::factorise(&system, cholesky).is_ok());
    (Minimum { objective: value, gradient_norm, positive_definite, ..Minimum::default() }, system)
}

/// The returns that no beams of other scans passed through; the evidence's surfaces become theirs.
fn what_stands(
    job: &Job<'_>,
    returns: Vec<Return>,
    viewpoints: &[Viewpoint],
    evidence: &mut Evidence,
    observer: Observer<'_>,
) -> Result<Vec<Return>, FitError> {
    let h = job.lattice.resolution;
    let (surfels, owners) = Surfels::gather(&returns, &normals::outward(&returns, h), viewpoints, h);
    let poses: Vec<Pose> = job.scans.iter().map(|scan| scan.pose).collect();
    let progress = Progress { max_iterations: job.options.max_iterations, ..Progress::NONE };
    let go_on = &mut || observer(&progress).is_continue();
    let stands = standing::standing(&surfels, job.scans, &poses, h, go_on).ok_or(FitError::Cancelled)?;
    if stands.iter().all(|stands| *stands) || !stands.contains(&true) {
        return Ok(returns);
    }
    let gone = returns.iter().zip(&owners).filter(|(_, owner)| !stands[**owner]).map(|(seen, _)| seen.point);
    evidence.forget_surfaces(
        job.lattice,
        gone,
        returns.iter().zip(&owners).filter(|(_, o)| stands[**o]).map(|(seen, _)| seen.point),
    );
    Ok(returns.iter().zip(&owners).filter(|(_, owner)| stands[**owner]).map(|(seen, _)| *seen).collect())
}

/// The Hessian's convex stand-in, a little more than positive semi-definite.
fn stand_in(objective: &Objective, unknowns: &[f64], system: &mut System) {
    objective.assemble(unknowns, Curvature::CONVEX, system);
    let n = objective.lattice.len();
    let scale = system.hessian.diagonal()[..n].iter().sum::<f64>() / n as f64;
    system.hessian.shift_diagonal(|_, _| STAND_IN_RIDGE * scale);
}

/// What the stand-in has more, as a share of its mean diagonal.
const STAND_IN_RIDGE: f64 = 1e-9;

/// Where the pose unknowns put the returns.
fn places(objective: &Objective, e: &[f64]) -> Vec<Vec2> {
    let mut places = vec![Vec2::zeros(); objective.sightings.returns.len()];
    let placed = objective.sightings.at(&objective.lattice, e);
    placed.iter().for_each(|sighting| places[sighting.source] = sighting.seen.point);
    places
}

/// The Eikonal loss over a cell with side `h`.
fn eikonal_loss(weights: &Weights, weighting: Weighting, h: f64) -> EikonalLoss {
    let weight = match weighting {
        Weighting::Paper => weights.eikonal * 4.0,
        Weighting::Calibrated => weights.eikonal * h * h,
    };
    EikonalLoss { weight, scale: weights.eikonal_scale }
}

/// The way from the start to the minimum: stages where the weighting is calibrated, then the final weights.
struct Descent<'a> {
    objective: &'a mut Objective,
    cholesky: &'a mut Cholesky,
    weights: &'a Weights,
    options: &'a FitOptions,
}

impl Descent<'_> {
    /// Minimises from the coefficients of the start; `unknowns` grow by the pose unknowns. Gradient and Hessian at the
    /// end are given with the minimum.
    fn run(
        &mut self,
        unknowns: &mut Vec<f64>,
        loss: EikonalLoss,
        severity: f64,
        observer: Observer<'_>,
    ) -> Result<(Minimum, System), FitError> {
        let (refined, smoothing) = (self.weights.poses == Poses::Refined, self.weights.smoothing);
        let calibrated = self.options.weighting == Weighting::Calibrated;
        self.objective.reweigh(loss, smoothing, refined);
        unknowns.resize(self.objective.unknowns(), 0.0);
        let first_gradient = newton::largest(&self.objective.gradient(unknowns));
        let mut spent = Minimum::default();
        let stages =
            loss.scale.filter(|_| calibrated).map(|scale| continuation::stages(severity, scale, self.weights.eikonal));
        for stage in stages.into_iter().flatten() {
            self.objective.reweigh(stage.loss(loss), smoothing * stage.smoothing, stage.refined && refined);
            unknowns.resize(self.objective.unknowns(), 0.0);
            let rule = stage.rule(spent.iterations, self.options.max_iterations);
            let limit = self.options.max_iterations;
            let mut of_the_whole = |progress: &Progress| observer(&Progress { max_iterations: limit, ..*progress });
            spent = Newton::new(self.objective, self.cholesky, spent).minimise(unknowns, &rule, &mut of_the_whole)?;
        }
        self.objective.reweigh(loss, smoothing, refined);
        let rule = StoppingRule {
            max_iterations: self.options.max_iterations,
            tolerance: self.options.tolerance,
            first_gradient: Some(first_gradient),
            certify: true,
            chords: if calibrated { 0 } else { CHORDS },
            law: if loss.scale.is_some() { Law::Concavity } else { Law::Slopes },
        };
        let mut newton = Newton::new(self.objective, self.cholesky, spent);
        let minimum = newton.minimise(unknowns, &rule, observer)?;
        Ok((minimum, newton.system))
    }
}

#[cfg(test)]
mod tests;
