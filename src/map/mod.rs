//! A fitted map: the surface, its uncertainty, where there is evidence; questions about it, and its files.
//!
//! [`FittedMap`] is made from a [`Fit`] or a [`VectorFit`] once; from then on it never changes. Its [`Field`] is a
//! signed or a vector distance; `query` answers what lies at a point. [`npz`] is how arrays become files that numpy
//! opens; `archive` is a map as such files.

mod archive;
mod field;
pub mod npz;
mod query;

use serde::{Deserialize, Serialize};

pub use archive::{ArchiveError, factors_from_npz, factors_to_npz, on_lattice_npz, scipy_sparse, write_columns};
pub use field::{Field, VectorAt};
pub use query::Answer;

use crate::fit::{Fit, Minimum, PublishedVectorFit, VectorFit, Weighting, Weights};
use crate::geometry::{Pose, Vec2};
use crate::scan::{Evidence, Noise};
use crate::spline::Lattice;
use crate::uncertainty::{Factors, PoseCovariance, UncertaintyError, marginals, published_marginals, vector_marginals};

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

/// A finished map.
#[derive(Debug, Clone)]
pub struct FittedMap {
    pub field: Field,
    pub evidence: Evidence,
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
    ) -> Result<(Self, Factors), UncertaintyError> {
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
        let map = Self {
            field: Field::Signed { surface: fit.surface, marginals },
            evidence: fit.evidence,
            report,
            poses: fit.poses,
            pose_covariance,
            returns,
            noise,
        };
        Ok((map, factors))
    }

    /// The map of a vector fit, likewise.
    pub fn finish_vector(
        mut fit: VectorFit,
        noise: Noise,
        seconds: impl FnOnce() -> f64,
    ) -> Result<(Self, Factors), UncertaintyError> {
        let (marginals, pose_covariance) = vector_marginals(&mut fit)?;
        let factors = Factors::of_vector(&fit);
        let (weighting, observations) = (Weighting::Calibrated, fit.returns.len());
        let report = FitReport {
            seen_through: Some(fit.seen_through),
            cut_locus: Some(fit.left_out),
            active_control_points: Some(fit.cholesky.stencil().active_len()),
            ..FitReport::of(weighting, fit.converged, fit.minimum, observations, fit.weights, seconds())
        };
        let map = Self {
            field: Field::Vector { components: fit.field, marginals: Box::new(marginals) },
            evidence: fit.evidence,
            report,
            poses: fit.poses,
            pose_covariance,
            returns: fit.returns,
            noise,
        };
        Ok((map, factors))
    }

    /// The map of the published vector objective, likewise.
    pub fn finish_published_vector(
        mut fit: PublishedVectorFit,
        poses: Vec<Pose>,
        noise: Noise,
        seconds: impl FnOnce() -> f64,
    ) -> Result<(Self, Factors), UncertaintyError> {
        let (marginals, factors) = published_marginals(&mut fit)?;
        let (stencil, observations) = (fit.cholesky.stencil(), fit.returns.len());
        let report = FitReport {
            active_control_points: Some(stencil.active_len()),
            ..FitReport::of(Weighting::Paper, false, fit.minimum, observations, fit.weights, seconds())
        };
        let map = Self {
            field: Field::Vector { components: fit.field, marginals: Box::new(marginals) },
            evidence: fit.evidence,
            report,
            poses,
            pose_covariance: PoseCovariance::default(),
            returns: fit.returns.iter().map(|seen| seen.point).collect(),
            noise,
        };
        Ok((map, factors))
    }

    pub fn lattice(&self) -> &Lattice {
        self.field.lattice()
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
