//! The weighted non-linear least-squares fit of a distance to scans.
//!
//! [`fit`] is the one way in; which objective it minimises is its own business:
//!
//! | room | what it fits |
//! | --- | --- |
//! | `signed` | one surface, the signed distance, `calibrated` and `paper` |
//! | `vector` | two surfaces, the vector distance, `calibrated` |
//! | `published` | the same by the published objective, for comparison |
//!
//! All end as one [`Estimate`]: components, one sparse system over control points and poses (`system`), the derivatives
//! by the inputs, a report. `surfels` gathers returns into pieces of surface and tells what stands.

mod collocation;
mod estimate;
mod footprint;
pub mod gauge;
mod options;
mod published;
mod signed;
mod surfels;
mod system;
mod vector;
mod viewpoint;

use std::ops::ControlFlow;
use std::sync::Arc;

use thiserror::Error;

pub(crate) use estimate::PRIOR;
pub use estimate::{Distance, Estimate, Input, Inputs, Minimum};
pub use footprint::{Footprint, control_points, footprint, pose_entries};
pub use options::{FitOptions, Poses, Weighting, Weights};
pub use signed::{
    Curvature, EikonalLoss, Law, LocalJet, Newton, Objective, Placed, Sighting, Sightings, StoppingRule, Weighing,
    least_squares, signed_nearest_return,
};
pub use surfels::{Surfel, Surfels, Witness};
pub use system::{Factor, System};
pub use viewpoint::{Viewpoint, pose_unknowns};

use crate::scan::{Evidence, LaserScan, Noise};
use crate::sparse::{Cholesky, Pattern, SparseError, Stencil, Team};
use crate::spline::{Lattice, Surface};

#[derive(Debug, Error)]
pub enum FitError {
    #[error("no return lies inside the map's bounds")]
    NoEvidence,
    #[error("the pose covariance of scan {scan} is not positive semi-definite")]
    PoseCovariance { scan: usize },
    #[error("the objective is not finite: the input's scale or noise is out of all proportion")]
    NotFinite,
    #[error("the scans and priors do not determine the map: its Hessian is not positive definite")]
    Undetermined,
    #[error("cancelled")]
    Cancelled,
    #[error(transparent)]
    Sparse(SparseError),
}

impl From<SparseError> for FitError {
    fn from(error: SparseError) -> Self {
        match error {
            SparseError::NotPositiveDefinite => Self::Undetermined,
            SparseError::Stopped => Self::Cancelled,
            other => Self::Sparse(other),
        }
    }
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

/// Is told how a fit goes, and says whether it goes on.
pub type Observer<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

impl Progress {
    /// Before anything is known.
    pub const NONE: Self = Self { iteration: 0, max_iterations: 1, objective: f64::NAN, relative_gradient: 1.0 };

    /// How much of the fit is done: of the allowed steps, or of the decades the gradient has to fall.
    pub fn share(&self, tolerance: f64) -> f64 {
        let by_steps = self.iteration as f64 / self.max_iterations.max(1) as f64;
        let by_gradient = self.relative_gradient.max(1e-300).log10() / tolerance.log10();
        by_steps.max(by_gradient).clamp(0.0, 1.0)
    }
}

/// Where a fit ended: what [`resume`] goes on from.
#[derive(Debug, Clone, Copy)]
pub struct End<'a> {
    /// Component by component; NaN at control points that are not in use.
    pub coefficients: &'a [&'a [f64]],
    /// [`Estimate::resume`].
    pub poses: &'a [f64],
    /// Whether the Hessian was positive definite there, where that is known of this very point.
    pub positive_definite: Option<bool>,
}

/// What is to be fitted.
#[derive(Debug, Clone, Copy)]
struct Job<'a> {
    scans: &'a [LaserScan],
    noise: &'a Noise,
    lattice: &'a Lattice,
    options: &'a FitOptions,
    /// Who shares the linear algebra.
    team: &'a Team,
    /// Where the fit ended before, if it is not to be fitted again.
    end: Option<End<'a>>,
}

impl Job<'_> {
    /// What the scans say about the lattice's area. Many scans of a large one take a while, and are told to stop, too.
    fn evidence(&self, observer: Observer<'_>) -> Result<Evidence, FitError> {
        let progress = Progress { max_iterations: self.options.max_iterations, ..Progress::NONE };
        let mut goes_on = || observer(&progress).is_continue();
        Evidence::gather_while(self.lattice, self.scans, &mut goes_on).ok_or(FitError::Cancelled)
    }

    /// A factorisation for the system to come, by the job's team.
    fn cholesky(&self, stencil: &Arc<Stencil>) -> Result<Cholesky, SparseError> {
        Ok(Cholesky::analyse(&Pattern::of_stencil(stencil))?.with_team(self.team.clone()))
    }

    /// The coefficients of a component where the fit ended, with zero for control points that are not in use.
    fn ended(&self, component: usize) -> Option<Vec<f64>> {
        let own = self.end.as_ref()?.coefficients.get(component)?;
        (own.len() == self.lattice.len()).then(|| own.iter().map(|c| if c.is_nan() { 0.0 } else { *c }).collect())
    }
}

#[cfg(test)]
impl<'a> Job<'a> {
    /// A fit from the start, by one thread.
    fn alone(scans: &'a [LaserScan], noise: &'a Noise, lattice: &'a Lattice, options: &'a FitOptions) -> Self {
        static ALONE: Team = Team::alone();
        Self { scans, noise, lattice, options, team: &ALONE, end: None }
    }
}

/// Fits a distance; the same bytes whoever is in the team. The observer is called at every step; `Break` cancels the fit
/// within that step.
pub fn fit(
    scans: &[LaserScan],
    noise: &Noise,
    distance: Distance,
    lattice: &Lattice,
    options: &FitOptions,
    team: &Team,
    observer: Observer<'_>,
) -> Result<Estimate, FitError> {
    dispatch(&Job { scans, noise, lattice, options, team, end: None }, distance, observer)
}

/// The estimate of a fit that has ended before, from where it ended: system and inputs are assembled there, nothing is
/// minimised. What a stored map's covariance is formed from on demand. `go_on` says whether to go on.
pub fn resume(
    scans: &[LaserScan],
    noise: &Noise,
    distance: Distance,
    lattice: &Lattice,
    options: &FitOptions,
    team: &Team,
    (end, go_on): (End<'_>, &dyn Fn() -> bool),
) -> Result<Estimate, FitError> {
    let job = Job { scans, noise, lattice, options, team, end: Some(end) };
    let mut observer = |_: &Progress| if go_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
    dispatch(&job, distance, &mut observer)
}

fn dispatch(job: &Job<'_>, distance: Distance, observer: Observer<'_>) -> Result<Estimate, FitError> {
    match (distance, job.options.weighting) {
        (Distance::Signed, _) => signed::fit(job, observer),
        (Distance::Vector, Weighting::Calibrated) => vector::fit(job, observer),
        (Distance::Vector, Weighting::Paper) => published::fit(job, observer),
    }
}

/// Why a fit did not converge, in words.
fn why_not(converged: bool, minimum: &Minimum, options: &FitOptions) -> Option<String> {
    if converged {
        return None;
    }
    let Minimum { iterations, relative_gradient, positive_definite, .. } = *minimum;
    Some(match (relative_gradient <= options.tolerance, positive_definite) {
        (true, _) => "the point reached is stationary, but its Hessian is not positive definite".into(),
        (false, _) if iterations >= options.max_iterations => format!(
            "{iterations} steps left a relative gradient of {relative_gradient:.1e} (tolerance {:.0e}); \
             fit.max_iterations allows more",
            options.tolerance
        ),
        (false, _) => {
            format!("no step lowers the objective any more, at a relative gradient of {relative_gradient:.1e}")
        }
    })
}

/// The surface of coefficients: NaN at control points that are not in use.
fn in_use(lattice: &Lattice, stencil: &Stencil, mut coefficients: Vec<f64>) -> Surface {
    coefficients.iter_mut().enumerate().filter(|(k, _)| !stencil.is_active(*k)).for_each(|(_, c)| *c = f64::NAN);
    Surface { lattice: lattice.clone(), coefficients }
}
