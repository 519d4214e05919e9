//! The weighted non-linear least-squares fit of a signed distance surface to scans.
//!
//! [`fit`] is the one way in: it gathers evidence, makes a start (`start`), sets up the objective (`objective`) with
//! resolved weights (`options`) and minimises it (`newton`). The result keeps what the covariance needs: the
//! objective, the unknowns and the Hessian at the minimum.

mod bordered;
mod chain;
mod continuation;
mod damping;
mod eikonal;
pub mod gauge;
mod loss;
mod newton;
mod objective;
mod options;
mod sampson;
mod sightings;
mod start;
mod vector;

use std::ops::ControlFlow;

use thiserror::Error;

pub use bordered::{Bordered, System};
pub(crate) use bordered::{pose_block, solve_components};
pub use chain::{InputJet, by_inputs};
pub use damping::Law;
pub use eikonal::EikonalLoss;
pub use loss::{Curvature, LocalJet};
pub use newton::{Minimum, Newton, StoppingRule};
pub use objective::Objective;
pub(crate) use objective::local_jet;
pub use options::{FitOptions, Poses, Weighting, Weights};
pub use sightings::{Placed, Sighting, Sightings, Viewpoint, Weighing};
pub use start::{least_squares, signed_nearest_return};
pub use vector::{
    PublishedVectorFit, Surfel, Surfels, VectorFit, VectorObjective, Witness, fit_published_vector, fit_vector,
};

use crate::geometry::{Cov3, Pose, psd_square_root};
use crate::scan::{Evidence, LaserScan, Noise, Return, ReturnNoise, returns_of};
use crate::sparse::{Cholesky, SparseError, Stencil};
use crate::spline::{Lattice, Surface};

/// Refining poses takes this many numbers at most (control points x pose unknowns): beyond, a step would be all border.
const LARGEST_BORDER: usize = 2_000_000;

/// `calibrated` asks for unit slope where there is evidence, and this many cells around it. Farther off, nothing says
/// which of the many distance functions is the true one; the surface is continued smoothly, and a fit of a half-seen
/// place converges.
const EIKONAL_BAND: f64 = 1.0;

/// Steps a factorisation serves after its own under the squared loss, whose Hessian changes slowly along its valleys.
const CHORDS: usize = 1;

#[derive(Debug, Error)]
pub enum FitError {
    #[error("no return lies inside the map's bounds")]
    NoEvidence,
    #[error("the pose covariance of scan {scan} is not positive semi-definite")]
    PoseCovariance { scan: usize },
    #[error("the objective is not finite: the input's scale or noise is out of all proportion")]
    NotFinite,
    #[error("cancelled")]
    Cancelled,
    #[error(transparent)]
    Sparse(#[from] SparseError),
}

/// Where a running fit stands; reported at every step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    pub iteration: usize,
    pub max_iterations: usize,
    pub objective: f64,
    /// The gradient's largest entry over the start's.
    pub relative_gradient: f64,
}

/// A fit at its end.
pub struct Fit {
    pub surface: Surface,
    pub evidence: Evidence,
    pub minimum: Minimum,
    pub weights: Weights,
    pub weighting: Weighting,
    /// Stationary within tolerance, and the exact Hessian positive definite.
    pub converged: bool,
    pub objective: Objective,
    /// Coefficients, then pose unknowns.
    pub unknowns: Vec<f64>,
    /// Gradient and exact Hessian at the end.
    pub system: System,
    /// Set up for the lattice; holds the factor of `system.hessian` where that is positive definite.
    pub cholesky: Cholesky,
    /// The poses as the fit leaves them: refined, or as reported.
    pub poses: Vec<Pose>,
}

/// Fits a surface. The observer is called at every step; `Break` cancels the fit within that step.
pub fn fit(
    scans: &[LaserScan],
    noise: &Noise,
    lattice: &Lattice,
    options: &FitOptions,
    observer: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Fit, FitError> {
    let returns = returns_inside(scans, lattice)?;
    let refinable = lattice.len().saturating_mul(3 * scans.len()) <= LARGEST_BORDER;
    let mut viewpoints = viewpoints(scans, noise, 0.0)?;
    let scatter = scatter(&returns, &viewpoints);
    let information = information(lattice, &returns, scatter);
    let weights = Weights::resolve(options, lattice.resolution, refinable, information);
    viewpoints.iter_mut().for_each(|own| own.noise.model_variance = weights.model_sigma.powi(2));
    let evidence = Evidence::gather(lattice, scans);
    let stencil = match options.band {
        Some(band) => Stencil::of_cells(lattice, &evidence.cells_within(lattice, band)),
        None => Stencil::of(lattice),
    };
    let mut cholesky = Cholesky::analyse(&stencil)?;
    let calibrated = options.weighting == Weighting::Calibrated;
    let severity = if calibrated { continuation::severity(scatter, lattice.resolution) } else { 0.0 };
    let start = signed_nearest_return(lattice, &returns, &evidence, severity, &mut cholesky)?;
    let weighing = match options.weighting {
        Weighting::Paper => Weighing::Frozen(sightings::published_weights(&returns, &viewpoints, &start)),
        Weighting::Calibrated => Weighing::Sampson,
    };
    let sightings = Sightings::new(lattice, returns, viewpoints, weighing);
    let loss = weights.eikonal_loss(options.weighting, lattice.resolution);
    let cells = calibrated.then(|| evidence.cells_within(lattice, EIKONAL_BAND));
    let points = if calibrated { 3 } else { 2 };
    let mut objective =
        Objective::new(lattice.clone(), stencil.clone(), sightings, loss, weights.smoothing, cells, points);

    let mut unknowns = start.coefficients;
    let mut descent = Descent { objective: &mut objective, cholesky: &mut cholesky, weights: &weights, options };
    let (minimum, system) = descent.run(&mut unknowns, loss, severity, observer)?;
    let poses = corrected(scans, &objective.sightings.viewpoints, &unknowns[lattice.len()..]);
    Ok(Fit {
        surface: in_use(lattice, &stencil, unknowns[..lattice.len()].to_vec()),
        evidence,
        converged: minimum.relative_gradient <= options.tolerance && minimum.positive_definite,
        minimum,
        weights,
        weighting: options.weighting,
        objective,
        unknowns,
        system,
        cholesky,
        poses,
    })
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
        observer: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
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

/// The returns inside the lattice; that there is none is an error.
fn returns_inside(scans: &[LaserScan], lattice: &Lattice) -> Result<Vec<Return>, FitError> {
    let returns: Vec<Return> =
        returns_of(scans).into_iter().filter(|seen| lattice.locate(seen.point).is_some()).collect();
    if returns.is_empty() { Err(FitError::NoEvidence) } else { Ok(returns) }
}

/// The median standard deviation of a return, its pose's share included, metres. The viewpoints' poses are as reported.
fn scatter(returns: &[Return], viewpoints: &[Viewpoint]) -> f64 {
    let mut scatter: Vec<f64> = returns
        .iter()
        .map(|seen| viewpoints[seen.scan].noise.covariance(seen).symmetric_eigenvalues().max().max(0.0).sqrt())
        .collect();
    let middle = scatter.len() / 2;
    *scatter.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// How many times over returns of such a sigma determine a cell of wall: returns an occupied cell x (h / sigma)^2.
fn information(lattice: &Lattice, returns: &[Return], sigma: f64) -> f64 {
    let mut cells: Vec<usize> =
        returns.iter().filter_map(|seen| lattice.locate(seen.point)).map(|at| lattice.cell_index(at.cell)).collect();
    cells.sort_unstable();
    cells.dedup();
    let density = returns.len() as f64 / cells.len().max(1) as f64;
    density * (lattice.resolution / sigma).powi(2)
}

fn viewpoints(scans: &[LaserScan], noise: &Noise, model_sigma: f64) -> Result<Vec<Viewpoint>, FitError> {
    scans
        .iter()
        .enumerate()
        .map(|(scan, laser)| {
            let covariance: Cov3 = laser.pose_covariance(noise);
            let root = psd_square_root(&covariance).ok_or(FitError::PoseCovariance { scan })?;
            let noise = ReturnNoise {
                pose: Some(covariance),
                range_variance: noise.sigma_range.powi(2),
                model_variance: model_sigma.powi(2),
            };
            Ok(Viewpoint { position: laser.pose.position(), root, noise })
        })
        .collect()
}

/// The surface of coefficients: NaN at control points that are not in use.
fn in_use(lattice: &Lattice, stencil: &Stencil, mut coefficients: Vec<f64>) -> Surface {
    coefficients.iter_mut().enumerate().filter(|(k, _)| !stencil.is_active(*k)).for_each(|(_, c)| *c = f64::NAN);
    Surface { lattice: lattice.clone(), coefficients }
}

/// The poses for the pose unknowns `e`, which are empty where poses are fixed.
fn corrected(scans: &[LaserScan], viewpoints: &[Viewpoint], e: &[f64]) -> Vec<Pose> {
    scans
        .iter()
        .enumerate()
        .map(|(scan, laser)| (laser.pose, viewpoints[scan].correction(scan, e)))
        .map(|(pose, change)| Pose::new(pose.x + change.x, pose.y + change.y, pose.theta + change.z))
        .collect()
}

#[cfg(test)]
mod tests;
