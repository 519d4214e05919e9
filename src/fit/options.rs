//! What a caller may choose about a fit, and what became of it.

use serde::{Deserialize, Serialize};

/// Which objective is minimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Weighting {
    /// The published objective and constants.
    Paper,
    /// Robust at the cut locus, Sampson's distance at returns, poses refined: what the accuracy and coverage tests
    /// hold.
    #[default]
    Calibrated,
}

/// Whether the scans' poses are unknowns of the fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Poses {
    Fixed,
    Refined,
}

/// A fit's options. What is `None` follows from the weighting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    pub weighting: Weighting,
    pub poses: Option<Poses>,
    pub max_iterations: usize,
    /// The relative gradient at which a fit counts as stationary.
    pub tolerance: f64,
    /// `rho_e`: per quadrature point for `paper`, per square metre for `calibrated`.
    pub eikonal_weight: Option<f64>,
    /// The Geman-McClure scale of `calibrated`; without a unit.
    pub eikonal_scale: Option<f64>,
    /// The thin-plate weight of `calibrated`, per metre squared.
    pub smoothing: Option<f64>,
    /// What stands for what the spline cannot follow, metres.
    pub model_sigma: Option<f64>,
    /// Control points are in use where evidence is at most this many cells away. `None`: a vector distance takes its
    /// own; a signed one, which continues smoothly into space nobody saw, has all.
    pub band: Option<f64>,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            weighting: Weighting::Calibrated,
            poses: None,
            max_iterations: 100,
            tolerance: 1e-8,
            eikonal_weight: None,
            eikonal_scale: None,
            smoothing: None,
            model_sigma: None,
            band: None,
        }
    }
}

/// The weights a fit used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
pub struct Weights {
    /// `rho_e`, in the unit that `eikonal_unit` names.
    pub eikonal: f64,
    pub eikonal_unit: String,
    /// The Geman-McClure scale; `null` for the squared loss.
    pub eikonal_scale: Option<f64>,
    /// The thin-plate weight.
    pub smoothing: f64,
    /// `frozen` (the published form) or `sampson`.
    pub observation: String,
    /// The standard deviation that stands for what the spline cannot follow, metres.
    pub model_sigma: f64,
    /// Whether the poses were unknowns of the fit.
    pub poses: Poses,
}

/// What `docs/calibration.md` settled on for experiment 1, by a grid search: `rho_e` per square metre, the robust
/// scale, the thin-plate weight. Both weights rise with the square root of the returns' information: with few, noisy
/// returns a stiff surface buys smooth ridges by moving walls; with many, a soft one lets them bend the map inside.
const CALIBRATED_EIKONAL: f64 = 3000.0;
const CALIBRATED_SCALE: f64 = 0.2;
const CALIBRATED_SMOOTHING: f64 = 1.0;
/// Experiment 1's spacing, metres, and its returns' information: how many times over they determine a cell of wall.
const PLAIN_SPACING: f64 = 0.2;
const PLAIN_INFORMATION: f64 = 175.0;
const LEAST_TRUST: f64 = 1.0 / 3.0;
pub(super) const MOST_TRUST: f64 = 4.0;
/// What a spline cannot follow, as a share of its spacing: 5 mm at h = 0.2 m.
const MODEL_SIGMA_SHARE: f64 = 0.025;
/// The published weight, per quadrature point.
const PAPER_EIKONAL: f64 = 0.125;

impl Weights {
    /// The weights of a signed map for a lattice of the given resolution. `information` is how many times over the returns determine a cell of wall: returns a cell x (h / sigma)^2.
    pub fn resolve(options: &FitOptions, resolution: f64, information: f64) -> Self {
        // Information per unit of length^4, whose root has the unit of `rho_e`; the thin plate's share has a cell's
        // size.
        let cells = resolution / PLAIN_SPACING;
        let trust = ((information / PLAIN_INFORMATION).sqrt() / cells.powi(2)).clamp(LEAST_TRUST, MOST_TRUST);
        match options.weighting {
            Weighting::Paper => Self {
                eikonal: options.eikonal_weight.unwrap_or(PAPER_EIKONAL),
                eikonal_unit: "per quadrature point".into(),
                eikonal_scale: options.eikonal_scale,
                smoothing: options.smoothing.unwrap_or(0.0),
                observation: "frozen".into(),
                model_sigma: 0.0,
                poses: Poses::Fixed,
            },
            Weighting::Calibrated => Self {
                eikonal: options.eikonal_weight.unwrap_or(CALIBRATED_EIKONAL * trust),
                eikonal_unit: "per m^2".into(),
                eikonal_scale: Some(options.eikonal_scale.unwrap_or(CALIBRATED_SCALE)),
                smoothing: options.smoothing.unwrap_or(CALIBRATED_SMOOTHING * trust.max(1.0) * cells.powi(2)),
                observation: "sampson".into(),
                model_sigma: options.model_sigma.unwrap_or(MODEL_SIGMA_SHARE * resolution),
                poses: options.poses.unwrap_or(Poses::Refined),
            },
        }
    }
}
