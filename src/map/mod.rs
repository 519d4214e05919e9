//! A fitted map: the surface, its uncertainty, where there is evidence; questions about it, and its files.
//!
//! [`FittedMap`] is made from an [`Estimate`] once; from then on it never changes. [`Survey`] is the way from scans to
//! it. Its [`Field`] is a signed or a vector distance, its [`Surfaces`] are where that vanishes; `query` answers what
//! lies at a point. [`npz`] is how arrays become files that numpy opens; `archive` is a map as such files.

mod archive;
mod clearance;
mod cost;
mod field;
pub mod npz;
mod query;
mod surfaces;
mod survey;
mod sweep;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use archive::{ArchiveError, factors_npz, on_lattice_npz, scipy_sparse, surfaces_npz};
pub use cost::{Cost, cost};
pub use field::{CellCovariance, Field, VectorAt};
pub(crate) use query::normal_cdf;
pub use query::{Answer, SlopeCovariance};
pub(crate) use surfaces::STRAY;
pub(crate) use surfaces::level::level_lines;
pub(crate) use surfaces::lines::zero_lines;
pub(crate) use surfaces::samples::Samples;
pub use surfaces::{Facet, Foot, Surfaces};
pub use survey::{Stage, Step, Survey, SurveyError};
pub(crate) use sweep::Sweep;

use self::clearance::Clearance;
use crate::fit::{Distance, Estimate, Weighting, Weights};
use crate::geometry::{Cov3, Pose, Vec2};
use crate::scan::{Evidence, Noise};
use crate::spline::Lattice;
use crate::uncertainty::{FrameShift, Kind, PoseCovariance, UncertaintyError, frame_shifts, marginals};

/// Why a fit gave no map.
#[derive(Debug, Error)]
pub enum MapError {
    #[error(transparent)]
    Uncertainty(#[from] UncertaintyError),
    #[error("the surfaces could not be traced: {0}")]
    Trace(#[from] ::contour::Error),
}

/// What a fit reports about itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "service", schema(as = Fit))]
pub struct FitReport {
    pub weighting: Weighting,
    /// Stationary within tolerance, and the exact Hessian positive definite.
    pub converged: bool,
    pub iterations: usize,
    pub factorisations: usize,
    pub objective: f64,
    /// The largest absolute entry of the gradient at the end.
    pub gradient_norm: f64,
    /// `gradient_norm` over the start's.
    pub relative_gradient: f64,
    pub positive_definite: bool,
    /// Returns inside the map.
    pub observations: usize,
    /// How long the fit and its covariance took.
    pub seconds: f64,
    /// The same by stage.
    #[serde(default)]
    pub stages: StageSeconds,
    /// Why the fit did not converge, where it did not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unconverged: Option<String>,
    pub weights: Weights,
    /// The share of the returns left out because beams of other scans passed where they were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen_through: Option<f64>,
    /// How far the surfaces miss the returns that were taken, root mean square, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms: Option<f64>,
    /// Of a vector map: the share of the space fitted that lies at the cut locus, where the field jumps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cut_locus: Option<f64>,
    /// The control points in use, where these are not all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub active_control_points: Option<usize>,
}

/// Seconds a map took, by stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
pub struct StageSeconds {
    pub fitting: f64,
    pub covariance: f64,
}

/// A field and where there is evidence: a map before its surfaces are traced.
#[derive(Debug, Clone, Copy)]
pub struct Chart<'a> {
    pub field: &'a Field,
    pub evidence: &'a Evidence,
}

/// A joined map's frame in the joined map.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Its place among the request's frames; the first, which is held, is not told.
    pub index: usize,
    /// How the fit moved it from where its scans were put: (x, y, theta), the turn about the origin of the joined map.
    pub motion: Pose,
    /// In (x, y, theta) of `motion`.
    pub covariance: Cov3,
    /// Where its scans were put; from there the fit is found again.
    pub put: Pose,
}

impl Frame {
    /// A shift, of a frame that is put at the origin until it is told otherwise. About the origin, `x' = x + c - turn c`.
    fn shifted(shift: FrameShift) -> Self {
        let (sin, cos) = shift.motion.z.sin_cos();
        let c = shift.center;
        let turned = Vec2::new(cos * c.x - sin * c.y, sin * c.x + cos * c.y);
        let moved = shift.motion.xy() + c - turned;
        // Moments about another center: the translation there has the turn's share.
        let jacobian = Cov3::new(1.0, 0.0, c.y, 0.0, 1.0, -c.x, 0.0, 0.0, 1.0);
        Self {
            index: shift.frame,
            motion: Pose::new(moved.x, moved.y, shift.motion.z),
            covariance: jacobian * shift.covariance * jacobian.transpose(),
            put: Pose::new(0.0, 0.0, 0.0),
        }
    }

    /// Where it lies.
    pub fn pose(&self) -> Pose {
        let (sin, cos) = self.motion.theta.sin_cos();
        let p = self.put.position();
        let moved = Vec2::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y) + self.motion.position();
        Pose::new(moved.x, moved.y, self.motion.theta + self.put.theta)
    }

    /// The covariance of that.
    pub fn pose_covariance(&self) -> Cov3 {
        let arm = self.pose().position() - self.motion.position();
        let jacobian = Cov3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x, 0.0, 0.0, 1.0);
        let own = jacobian * self.covariance * jacobian.transpose();
        (own + own.transpose()) * 0.5
    }
}

/// A finished map.
#[derive(Debug)]
pub struct FittedMap {
    pub field: Field,
    pub evidence: Evidence,
    pub surfaces: Surfaces,
    clearance: Clearance,
    pub report: FitReport,
    /// One a scan, refined or as reported.
    pub poses: Vec<Pose>,
    /// Empty where poses were fixed.
    pub pose_covariance: PoseCovariance,
    /// The returns where the fit's poses put them.
    pub returns: Vec<Vec2>,
    pub noise: Noise,
    /// Of a map that others were joined to: where their frames lie.
    pub frames: Vec<Frame>,
    /// From which pose unknowns the fit's last round went; see [`crate::fit::resume`].
    resume: Vec<f64>,
}

impl FittedMap {
    /// The map of an estimate: its covariance, and its surfaces. `go_on` is told which share of the work is done and says
    /// whether to go on.
    pub fn of(mut estimate: Estimate, noise: Noise, go_on: &dyn Fn(f64) -> bool) -> Result<Self, MapError> {
        let (marginals, pose_covariance) = marginals(&mut estimate, &|share| go_on(COVARIANCE_SHARE * share))?;
        let shifts = frame_shifts(&mut estimate)?;
        let covariances = Kind::ALL.map(|kind| CellCovariance::of(&marginals, kind));
        drop(marginals);
        let report = FitReport::of(&estimate);
        let Estimate { surfaces, surfels, evidence, poses, returns, resume, .. } = estimate;
        let field = Field::new(surfaces, covariances);
        check_determined(&field, &returns)?;
        if !go_on(COVARIANCE_SHARE) {
            return Err(UncertaintyError::Cancelled.into());
        }
        let surfaces = match surfels {
            Some(surfels) => Surfaces::of_surfels(&field, &surfels),
            None => Surfaces::of_lines(&field, &zero_lines(Chart { field: &field, evidence: &evidence })?),
        };
        let clearance = Clearance::default();
        let frames = shifts.into_iter().map(Frame::shifted).collect();
        Ok(Self {
            field,
            evidence,
            surfaces,
            clearance,
            report,
            poses,
            pose_covariance,
            returns,
            noise,
            frames,
            resume,
        })
    }

    pub fn lattice(&self) -> &Lattice {
        self.field.lattice()
    }

    /// Bytes it holds in memory, about: the covariances are nearly all of it.
    pub fn held_bytes(&self) -> usize {
        let parts = Kind::ALL.map(|kind| self.field.covariance(kind).parts.iter().map(|part| part.values.len()).sum());
        let numbers = parts.iter().sum::<usize>() + 8 * self.lattice().len() + 2 * self.returns.len();
        8 * numbers + self.surfaces.held_bytes()
    }

    /// From where [`crate::fit::resume`] finds the fit's end again: coefficients and pose unknowns.
    pub fn resume_from(&self) -> (Vec<&[f64]>, &[f64]) {
        (self.field.coefficients().into_iter().map(|(_, values)| values).collect(), &self.resume)
    }

    /// What surfaces are traced from.
    pub(crate) fn chart(&self) -> Chart<'_> {
        Chart { field: &self.field, evidence: &self.evidence }
    }
}

/// Refuses a map that knows less of its distance where surfaces were met than that it is on the map.
fn check_determined(field: &Field, returns: &[Vec2]) -> Result<(), UncertaintyError> {
    let [width, height] = field.lattice().bounds().size();
    let worst = returns
        .iter()
        .filter_map(|p| Some((field.across(*p, Kind::Posterior)?.1, p)))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    match worst {
        Some((sigma, p)) if !(sigma > 0.0 && sigma <= width.hypot(height)) => {
            let detail = format!("sigma at ({:.2}, {:.2}), where a surface was met, is {sigma:.1e} m", p.x, p.y);
            Err(UncertaintyError::IllConditioned { detail })
        }
        _ => Ok(()),
    }
}

/// The covariance's share of what is left to do after a fit.
const COVARIANCE_SHARE: f64 = 0.95;

impl FitReport {
    fn of(estimate: &Estimate) -> Self {
        let (minimum, stencil) = (estimate.minimum, estimate.system.hessian.pattern().stencil());
        Self {
            weighting: estimate.weighting,
            converged: estimate.converged,
            iterations: minimum.iterations,
            factorisations: minimum.factorisations,
            objective: minimum.objective,
            gradient_norm: minimum.gradient_norm,
            relative_gradient: minimum.relative_gradient,
            positive_definite: minimum.positive_definite,
            observations: estimate.returns.len(),
            seconds: 0.0,
            stages: StageSeconds::default(),
            unconverged: estimate.unconverged.clone(),
            weights: estimate.weights.clone(),
            seen_through: estimate.seen_through,
            rms: Some(estimate.rms),
            cut_locus: estimate.cut_locus,
            active_control_points: Some(stencil.active_len())
                .filter(|&active| estimate.distance == Distance::Vector || active < stencil.dimension()),
        }
    }
}
