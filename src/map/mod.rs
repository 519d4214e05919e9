//! A fitted map: the surface, its uncertainty, where there is evidence; questions about it, and its files.
//!
//! [`FittedMap`] is made from a [`Fit`] or a [`VectorFit`] once; from then on it never changes. Its [`Field`] is a
//! signed or a vector distance, its [`Surfaces`] are where that vanishes; `query` answers what lies at a point. [`npz`] is how arrays become files that numpy
//! opens; `archive` is a map as such files.

mod archive;
mod clearance;
mod field;
pub mod npz;
mod query;
mod surfaces;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use archive::{ArchiveError, factors_from_npz, factors_to_npz, on_lattice_npz, scipy_sparse, write_columns};
pub use field::{Field, VectorAt};
pub(crate) use query::normal_cdf;
pub use query::{Answer, SlopeCovariance};
pub(crate) use surfaces::level::level_lines;
pub(crate) use surfaces::lines::zero_lines;
pub(crate) use surfaces::samples::Samples;
pub use surfaces::{Facet, Foot, Surfaces};

use self::clearance::Clearance;
use crate::fit::{Fit, Minimum, PublishedVectorFit, Surfels, VectorFit, Weighting, Weights};
use crate::geometry::{Pose, Vec2};
use crate::scan::{Evidence, Noise};
use crate::spline::Lattice;
use crate::uncertainty::{Factors, PoseCovariance, UncertaintyError, marginals, published_marginals, vector_marginals};

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
    pub weights: Weights,
    /// Of a vector map: the share of the returns left out because beams of other scans passed where they were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen_through: Option<f64>,
    /// Of a vector map: the share of the space fitted that lies at the cut locus, where the field jumps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cut_locus: Option<f64>,
    /// The control points in use, where these are not all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub active_control_points: Option<usize>,
}

/// A field and where there is evidence: a map before its surfaces are traced.
#[derive(Debug, Clone, Copy)]
pub struct Chart<'a> {
    pub field: &'a Field,
    pub evidence: &'a Evidence,
}

/// A finished map.
#[derive(Debug, Clone)]
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
}

impl FittedMap {
    /// The map of a fit and the factors of its covariance. `seconds` since the fit began are for the report.
    pub fn finish(
        mut fit: Fit,
        noise: Noise,
        seconds: impl FnOnce() -> f64,
    ) -> Result<(Self, Factors), MapError> {
        let (marginals, pose_covariance) = marginals(&mut fit)?;
        let factors = Factors::of(&mut fit)?;
        let lattice = &fit.surface.lattice;
        let placed = fit.objective.sightings.at(lattice, &fit.unknowns[lattice.len()..]);
        let mut returns = vec![Vec2::zeros(); fit.objective.sightings.returns.len()];
        placed.iter().for_each(|sighting| returns[sighting.source] = sighting.seen.point);
        let minimum = fit.minimum;
        let stencil = fit.cholesky.stencil();
        let report = FitReport {
            active_control_points: Some(stencil.active_len()).filter(|&active| active < stencil.dimension()),
            ..FitReport::of(fit.weighting, fit.converged, minimum, returns.len(), fit.weights, seconds())
        };
        let field = Field::Signed { surface: fit.surface, marginals };
        Ok((Self::assemble(field, None, fit.evidence, report, (fit.poses, pose_covariance), returns, noise)?, factors))
    }

    /// The map of a vector fit, likewise.
    pub fn finish_vector(
        mut fit: VectorFit,
        noise: Noise,
        seconds: impl FnOnce() -> f64,
    ) -> Result<(Self, Factors), MapError> {
        let (marginals, pose_covariance) = vector_marginals(&mut fit)?;
        let factors = Factors::of_vector(&fit);
        let (weighting, observations) = (Weighting::Calibrated, fit.returns.len());
        let report = FitReport {
            seen_through: Some(fit.seen_through),
            cut_locus: Some(fit.left_out),
            active_control_points: Some(fit.cholesky.stencil().active_len()),
            ..FitReport::of(weighting, fit.converged, fit.minimum, observations, fit.weights, seconds())
        };
        let field = Field::Vector { components: fit.field, marginals: Box::new(marginals) };
        let poses = (fit.poses, pose_covariance);
        Ok((Self::assemble(field, Some(&fit.surfels), fit.evidence, report, poses, fit.returns, noise)?, factors))
    }

    /// The map of the published vector objective, likewise.
    pub fn finish_published_vector(
        mut fit: PublishedVectorFit,
        poses: Vec<Pose>,
        noise: Noise,
        seconds: impl FnOnce() -> f64,
    ) -> Result<(Self, Factors), MapError> {
        let (marginals, factors) = published_marginals(&mut fit)?;
        let (stencil, observations) = (fit.cholesky.stencil(), fit.returns.len());
        let report = FitReport {
            active_control_points: Some(stencil.active_len()),
            ..FitReport::of(Weighting::Paper, false, fit.minimum, observations, fit.weights, seconds())
        };
        let field = Field::Vector { components: fit.field, marginals: Box::new(marginals) };
        let returns = fit.returns.iter().map(|seen| seen.point).collect();
        let poses = (poses, PoseCovariance::default());
        Ok((Self::assemble(field, None, fit.evidence, report, poses, returns, noise)?, factors))
    }

    /// A map from what a fit leaves. Its surfaces are the surfels where there are any, else they are traced.
    fn assemble(
        field: Field,
        surfels: Option<&Surfels>,
        evidence: Evidence,
        report: FitReport,
        (poses, pose_covariance): (Vec<Pose>, PoseCovariance),
        returns: Vec<Vec2>,
        noise: Noise,
    ) -> Result<Self, MapError> {
        let surfaces = match surfels {
            Some(surfels) => Surfaces::of_surfels(&field, surfels),
            None => Surfaces::of_lines(&field, &zero_lines(Chart { field: &field, evidence: &evidence })?),
        };
        let clearance = Clearance::default();
        Ok(Self { field, evidence, surfaces, clearance, report, poses, pose_covariance, returns, noise })
    }

    pub fn lattice(&self) -> &Lattice {
        self.field.lattice()
    }

    /// What surfaces are traced from.
    pub(crate) fn chart(&self) -> Chart<'_> {
        Chart { field: &self.field, evidence: &self.evidence }
    }
}

impl FitReport {
    fn of(
        weighting: Weighting,
        converged: bool,
        minimum: Minimum,
        observations: usize,
        weights: Weights,
        seconds: f64,
    ) -> Self {
        Self {
            weighting,
            converged,
            iterations: minimum.iterations,
            factorisations: minimum.factorisations,
            objective: minimum.objective,
            gradient_norm: minimum.gradient_norm,
            relative_gradient: minimum.relative_gradient,
            positive_definite: minimum.positive_definite,
            observations,
            seconds,
            weights,
            seen_through: None,
            cut_locus: None,
            active_control_points: None,
        }
    }
}
