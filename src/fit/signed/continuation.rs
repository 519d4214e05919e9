//! From a noisy start to the basin of the right minimum: coarse to fine in the loss instead of the lattice.
//!
//! The robust Eikonal loss has many minima. Where returns scatter by half a cell, the start has two or three walls in
//! place of one, and a band without slope between them that the robust loss is content with; where poses are wrong by
//! more than that, every scan has walls of its own. So a fit goes through stages, each begun where the last one ended:
//!
//! ```text
//! poses as reported   scale s_1        smoothing x F            what the scans agree upon
//! poses refined       scale s_1        smoothing x F            the scans are brought together
//! poses refined       scale s_1 / 4    smoothing x F^(1/2)      walls sharpen
//! poses refined       scale 2 s        smoothing x F^(1/4)      the cut locus sharpens
//! ```
//!
//! A wide scale is nearly the squared loss, which closes doubled walls; it also lets ridges wander (the cut locus of a
//! hall with pillars can end in another topology), so `s_1` and `F` are only as large as the noise asks for. This is
//! graduated non-convexity (Blake and Zisserman 1987; Black and Rangarajan 1996) with the noise choosing where it
//! begins. A large Eikonal weight is a third of itself meanwhile: ridges then wander less long, for two thirds of the
//! factorisations.
//!
//! The stages' steps take the Hessian's convex stand-in ([`Law::Convex`]): point by point, for a robust loss, that is
//! reweighting. They are a way and not an end; nothing is indefinite on it, and a factorisation serves every step.

use super::damping::Law;
use super::eikonal::EikonalLoss;
use super::newton::StoppingRule;

/// One stage's weights in terms of the final ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stage {
    /// Whether poses are unknowns already, where they will be.
    pub refined: bool,
    /// The Geman-McClure scale.
    pub scale: f64,
    /// What multiplies the Eikonal weight.
    pub eikonal: f64,
    /// What multiplies the thin-plate weight.
    pub smoothing: f64,
    /// Steps at most.
    pub steps: usize,
}

/// A stage ends at this relative gradient: it is a way, not an end.
const LOOSE: f64 = 1e-2;

/// Returns that scatter by this share of a cell ask for the full graduation.
const SEVERE: f64 = 0.5;
const WIDEST_SCALE: f64 = 4.0;
const MOST_SMOOTHING: f64 = 100.0;
/// The Eikonal weight of the stages, per square metre, and its least share of the final one.
const SOFT: f64 = 1000.0;
const SOFTEST: f64 = 1.0 / 3.0;

/// How much graduation the returns' scatter asks for, in [0, 1]: their standard deviation over half a cell.
pub fn severity(scatter: f64, resolution: f64) -> f64 {
    (scatter / (SEVERE * resolution)).min(1.0)
}

/// The stages before the final weights: a Geman-McClure scale, and an Eikonal weight per square metre.
pub fn stages(severity: f64, scale: f64, eikonal: f64) -> [Stage; 4] {
    let widest = (WIDEST_SCALE * severity).max(2.0 * scale);
    let smoothing = (MOST_SMOOTHING * severity.powi(4)).max(1.0);
    let eikonal = (SOFT / eikonal).clamp(SOFTEST, 1.0);
    let stage = |refined, scale: f64, root: f64, steps| {
        let smoothing = smoothing.powf(root);
        Stage { refined, scale, eikonal, smoothing, steps }
    };
    [
        stage(false, widest, 1.0, 8),
        stage(true, widest, 1.0, 6),
        stage(true, (widest / 4.0).max(2.0 * scale), 0.5, 6),
        stage(true, 2.0 * scale, 0.25, 6),
    ]
}

impl Stage {
    pub fn loss(&self, last: EikonalLoss) -> EikonalLoss {
        EikonalLoss { scale: Some(self.scale), weight: last.weight * self.eikonal }
    }

    /// `spent` steps are behind; `most` is what the whole fit may take, of which the stages leave the last half.
    pub fn rule(&self, spent: usize, most: usize) -> StoppingRule {
        let last = (spent + self.steps).min(most / 2).max(spent);
        StoppingRule {
            max_iterations: last,
            tolerance: LOOSE,
            first_gradient: None,
            certify: false,
            chords: 0,
            law: Law::Convex,
        }
    }
}
