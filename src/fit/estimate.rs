//! A fit of any kind at its end: one estimate.
//!
//! A signed map has one component, a vector map two; both have their poses in one sparse system with the control
//! points. A pose that is not refined is in it, too, held by a prior so stiff that it does not move: what its error
//! does to the map is then the same algebra.

use nalgebra::Vector3;

use super::options::{Poses, Weighting, Weights};
use super::surfels::Surfels;
use super::system::System;
use super::viewpoint::Viewpoint;
use crate::geometry::{Pose, Vec2};
use crate::scan::Evidence;
use crate::sparse::{Cholesky, SparseError};
use crate::spline::{Lattice, SUPPORT, Surface};

/// The prior's curvature of a refined pose's unknowns, `|e|^2` differentiated twice, and what stands for a known one.
pub(crate) const PRIOR: f64 = 2.0;
pub(crate) const HELD: f64 = 1e12;

/// Which distance a map holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "service", derive(utoipa::ToSchema))]
pub enum Distance {
    /// Negative in free space: for places with an inside.
    #[serde(rename = "sdf")]
    Signed,
    /// The vector from the nearest surface point: for buildings with thin walls.
    #[serde(rename = "vdf")]
    Vector,
}

impl Distance {
    pub const ALL: [Self; 2] = [Self::Signed, Self::Vector];

    /// The name that the contract gives it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Signed => "sdf",
            Self::Vector => "vdf",
        }
    }

    /// How many surfaces hold it.
    pub fn components(self) -> usize {
        match self {
            Self::Signed => 1,
            Self::Vector => 2,
        }
    }
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

/// An input that the minimum depends on, in units of its standard deviation: the mixed derivatives of the objective by
/// it and by the unknowns it touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input<'a> {
    /// The lowest control point of its cell.
    pub first: usize,
    /// By the cell's control points, component by component.
    pub by_control_points: [[f64; SUPPORT]; 2],
    /// By the unknowns of poses that see the cell.
    pub by_poses: &'a [(usize, Vector3<f64>)],
}

/// All inputs of a fit but its poses' reports: ranges, and what the model cannot follow.
pub trait Inputs: Send {
    fn for_each(&self, each: &mut dyn FnMut(&Input<'_>));
}

/// See the module.
pub struct Estimate {
    pub distance: Distance,
    pub weighting: Weighting,
    pub lattice: Lattice,
    /// The components; NaN at control points that are not in use.
    pub surfaces: Vec<Surface>,
    pub evidence: Evidence,
    pub minimum: Minimum,
    pub weights: Weights,
    /// Stationary within tolerance, and the exact Hessian positive definite.
    pub converged: bool,
    /// Gradient and Hessian at the end: exact where [`Minimum::positive_definite`], else the convex stand-in.
    pub system: System,
    pub inputs: Box<dyn Inputs>,
    pub cholesky: Cholesky,
    pub viewpoints: Vec<Viewpoint>,
    /// As the fit leaves them: refined, or as reported.
    pub poses: Vec<Pose>,
    /// Where these poses put the returns inside the map.
    pub returns: Vec<Vec2>,
    /// What stands, of returns gathered.
    pub surfels: Option<Surfels>,
    /// The share of the returns that were left out because beams of other scans passed where they were.
    pub seen_through: Option<f64>,
    /// How far the surfaces miss the returns that were not, root mean square, metres.
    pub rms: f64,
    /// Why the fit did not converge, where it did not.
    pub unconverged: Option<String>,
    /// The pose unknowns from which [`super::resume`] finds this estimate again.
    pub resume: Vec<f64>,
    /// The share of the collocation points that lie on the cut locus and were left out.
    pub cut_locus: Option<f64>,
}

/// How far surfaces miss returns, root mean square, metres: by a signed field's value there, by a vector field's length.
pub(super) fn missed_by(surfaces: &[Surface], returns: impl Iterator<Item = Vec2>) -> f64 {
    let square = |p: Vec2| surfaces.iter().map(|own| own.value(p).map(|value| value * value)).sum::<Option<f64>>();
    let squares = returns.filter_map(square).filter(|square| square.is_finite());
    let (count, sum) = squares.fold((0_usize, 0.0), |(count, sum), square| (count + 1, sum + square));
    (sum / count.max(1) as f64).sqrt()
}

impl Estimate {
    /// Sets the factorisation up for the system's pattern, which a fit may have left behind.
    pub(crate) fn match_pattern(&mut self) -> Result<(), SparseError> {
        self.cholesky.match_pattern(self.system.hessian.pattern())
    }

    /// The curvature of the poses' prior.
    pub fn prior(&self) -> f64 {
        match self.weights.poses {
            Poses::Refined => PRIOR,
            Poses::Fixed => HELD,
        }
    }
}
