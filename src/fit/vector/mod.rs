//! The fit of a vector distance function: two surfaces `V = (V_x, V_y)`, `V(x) = x - nearest surface point`.
//!
//! The published objective asks for `|grad |V|| = 1` and `V.V = 0` at returns. It does not change when `V` is turned,
//! so its Hessian is singular, and at the wall, where `V` vanishes, its weights are unbounded. Ours asks for the vector
//! form of the same law. Along a characteristic `n`, the line from the nearest surface point, `V` grows by its own
//! direction:
//!
//! ```text
//! f(V) = sum over surfels  W |V(a) + delta n|^2
//!      + integral of       rho_e |(n . grad) V - n|^2      off the cut locus
//!      + integral of       lambda (thin-plate energy of V_x and of V_y)
//! ```
//!
//! `(n . grad) V = n` fixes the turn. With surfels ([`surfels`]) and directions ([`characteristics`]) taken from the
//! returns, `f` is quadratic and both components have the same Hessian: positive definite wherever there is evidence,
//! one minimum, one factorisation. The tangential part of `V` at a surfel vanishes with the same weight as the normal
//! one misses `-delta`. There is no factor 1/2.

mod characteristics;
mod normals;
mod objective;
mod published;
mod standing;
mod surfels;

use std::ops::ControlFlow;
use std::sync::Arc;

use faer::Mat;

pub use characteristics::Characteristics;
pub use objective::VectorObjective;
pub use published::{PublishedVectorFit, fit_published_vector};
pub use surfels::{Surfel, Surfels, Witness};

use super::options::MOST_TRUST;
use super::{
    Bordered, FitError, FitOptions, Minimum, Poses, Progress, Viewpoint, Weights, corrected, gauge, in_use,
    information, returns_inside, viewpoints,
};
use crate::geometry::{Pose, Vec2};
use crate::scan::{Evidence, LaserScan, Noise, Return};
use crate::sparse::{Cholesky, SparseError, Stencil};
use crate::spline::{Lattice, Surface};

/// Control points are in use where evidence is at most this many cells away, unless the request has a band.
const DEFAULT_BAND: f64 = 0.5;
/// Where poses are refined, returns may move by so many of their standard deviations and stay on the map, up to so many
/// cells.
const BAND_SIGMAS: f64 = 2.0;
const WIDEST_BAND: f64 = 5.0;
/// Refining poses takes this many numbers at most (coefficients x pose unknowns).
const LARGEST_BORDER: usize = 20_000_000;
/// The Eikonal weight, per square metre for returns like experiment 1's, and the thin-plate weight. Together they say
/// how stiff the field is. What is too stiff to turn inside a wall 0.15 m thick would rather move the poses of the
/// scans on either side of it, and what is stiff where the field jumps pulls at everything beside the jump; too soft,
/// and distances in the middle of rooms are loose.
const EIKONAL: f64 = 30.0;
const PLAIN_INFORMATION: f64 = 250.0;
const SMOOTHING: f64 = 0.003;
/// What a spline cannot follow of walls with jambs and ends, as a share of its spacing.
const MODEL_SIGMA_SHARE: f64 = 0.05;
/// How often surfels are gathered anew around better poses at most.
const MOST_ROUNDS: usize = 30;
/// Poses have settled where no return moves by more than this many cells: surfels are as good as gathered around them.
const SETTLED: f64 = 0.02;

/// A vector fit at its end.
pub struct VectorFit {
    /// `V_x` and `V_y`; NaN at control points that are not active.
    pub field: [Surface; 2],
    pub evidence: Evidence,
    pub minimum: Minimum,
    pub weights: Weights,
    /// Stationary within tolerance, and the poses have settled.
    pub converged: bool,
    pub surfels: Surfels,
    pub objective: VectorObjective,
    /// Holds the factor of the objective's Hessian.
    pub cholesky: Cholesky,
    pub viewpoints: Vec<Viewpoint>,
    pub poses: Vec<Pose>,
    /// Where the fit's poses put the returns.
    pub returns: Vec<Vec2>,
    /// The share of the collocation points that lie on the cut locus and were left out.
    pub left_out: f64,
    /// The share of the returns that were left out because beams of other scans passed where they were.
    pub seen_through: f64,
}

/// Fits a vector distance function.
pub fn fit_vector(
    scans: &[LaserScan],
    noise: &Noise,
    lattice: &Lattice,
    options: &FitOptions,
    observer: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<VectorFit, FitError> {
    let mut returns = returns_inside(scans, lattice)?;
    let refinable = 2 * lattice.len() * 3 * scans.len() <= LARGEST_BORDER;
    let weights = vector_weights(options, lattice, refinable, information(lattice, &returns, noise.sigma_range));
    let viewpoints = viewpoints_of(scans, noise, &weights)?;
    let mut evidence = Evidence::gather(lattice, scans);
    let default_band = match weights.poses {
        Poses::Refined => {
            DEFAULT_BAND.max(BAND_SIGMAS * farthest_sigma(&viewpoints) / lattice.resolution).min(WIDEST_BAND)
        }
        Poses::Fixed => DEFAULT_BAND,
    };
    let band = options.band.unwrap_or(default_band);
    let near = evidence.cells_within(lattice, band.min(default_band));
    let stencil = Stencil::of_cells(lattice, &evidence.cells_within(lattice, band));
    let place = Place { scans, lattice, viewpoints: &viewpoints, weights: &weights, near: &near, stencil: &stencil };
    let mut cholesky = Cholesky::analyse(&stencil)?;

    let refined = weights.poses == Poses::Refined;
    let rounds = if refined { MOST_ROUNDS.min(options.max_iterations) } else { 1 };
    let mut e = if refined { vec![0.0; 3 * scans.len()] } else { Vec::new() };
    let mut progress = Progress { iteration: 0, max_iterations: rounds, objective: f64::NAN, relative_gradient: 1.0 };
    let (round, change) = loop {
        if observer(&progress).is_break() {
            return Err(FitError::Cancelled);
        }
        let round = place.round(&returns, &e, &mut cholesky)?;
        e.clone_from(&round.poses);
        let change = put(&mut returns, scans, &corrected(scans, &viewpoints, &e)) / lattice.resolution;
        progress.iteration += 1;
        progress.objective = round.minimum.objective;
        progress.relative_gradient = change.max(round.minimum.relative_gradient);
        if change <= SETTLED || progress.iteration == rounds {
            break (round, change);
        }
    };
    evidence.replace_surfaces(lattice, round.surfels.all.iter().map(Surfel::ends));
    let minimum = Minimum { iterations: progress.iteration, factorisations: progress.iteration, ..round.minimum };
    Ok(VectorFit {
        field: round.components.map(|c| in_use(lattice, &stencil, c)),
        evidence,
        converged: minimum.relative_gradient <= options.tolerance && change <= SETTLED,
        minimum,
        surfels: round.surfels,
        objective: round.objective,
        cholesky,
        returns: returns.iter().map(|seen| seen.point).collect(),
        poses: corrected(scans, &viewpoints, &e),
        left_out: round.left_out,
        seen_through: round.seen_through,
        viewpoints,
        weights,
    })
}

/// What stays the same from round to round.
struct Place<'a> {
    scans: &'a [LaserScan],
    lattice: &'a Lattice,
    viewpoints: &'a [Viewpoint],
    weights: &'a Weights,
    /// The cells near evidence: there alone the field's course is asked for; beyond, it continues smoothly.
    near: &'a [bool],
    stencil: &'a Arc<Stencil>,
}

/// Surfels gathered around one set of poses, and the minimum of the objective they make.
struct Round {
    surfels: Surfels,
    objective: VectorObjective,
    minimum: Minimum,
    components: [Vec<f64>; 2],
    /// The pose unknowns at the minimum.
    poses: Vec<f64>,
    left_out: f64,
    seen_through: f64,
}

impl Place<'_> {
    /// One round. `returns` lie where the pose unknowns `e` put them, which are empty where poses are fixed.
    fn round(&self, returns: &[Return], e: &[f64], cholesky: &mut Cholesky) -> Result<Round, FitError> {
        let &Self { scans, lattice, viewpoints, weights, near, stencil } = self;
        let normals = normals::outward(returns, lattice.resolution);
        let mut surfels = Surfels::gather(returns, &normals, viewpoints, lattice.resolution);
        let poses = corrected(scans, viewpoints, e);
        let kept = surfels.keep(&standing::standing(&surfels, scans, &poses, lattice.resolution));
        let traced = Characteristics::trace(lattice, &surfels, near);
        let gauge = if e.is_empty() { Mat::zeros(0, 0) } else { gauge::common_motion(viewpoints) };
        let objective = VectorObjective::assemble(lattice, stencil.clone(), &surfels, &traced, weights, (e, gauge));
        let border = Bordered::factorise(&objective.system, cholesky).map_err(|error| match error {
            SparseError::NotPositiveDefinite => FitError::NotFinite,
            other => other.into(),
        })?;
        let downhill: Vec<f64> = objective.system.gradient.iter().map(|slope| -slope).collect();
        let mut x = border.solve_checked(&objective.system, cholesky, &downhill)?;
        let minimum = objective.minimum(&x);
        let poses = x.split_off(2 * lattice.len());
        let y = x.split_off(lattice.len());
        let (left_out, seen_through) = (traced.left_out, 1.0 - kept);
        Ok(Round { surfels, objective, minimum, components: [x, y], poses, left_out, seen_through })
    }
}

fn vector_weights(options: &FitOptions, lattice: &Lattice, refinable: bool, information: f64) -> Weights {
    let mut weights = Weights::resolve(options, lattice.resolution, refinable, information);
    let trust = (information / PLAIN_INFORMATION).sqrt().clamp(1.0, MOST_TRUST);
    weights.observation = "surfels".into();
    weights.eikonal_scale = None;
    weights.eikonal = options.eikonal_weight.unwrap_or(EIKONAL * trust);
    weights.smoothing = options.smoothing.unwrap_or(SMOOTHING);
    weights.model_sigma = options.model_sigma.unwrap_or(MODEL_SIGMA_SHARE * lattice.resolution);
    weights
}

/// The largest standard deviation of a pose's x or y, metres.
fn farthest_sigma(viewpoints: &[Viewpoint]) -> f64 {
    let variances = viewpoints.iter().flat_map(|own| (0..2).map(|axis| own.root.row(axis).norm_squared()));
    variances.fold(0.0, f64::max).sqrt()
}

/// Viewpoints whose returns have the ranges' noise alone where poses are unknowns.
fn viewpoints_of(scans: &[LaserScan], noise: &Noise, weights: &Weights) -> Result<Vec<Viewpoint>, FitError> {
    let mut viewpoints = viewpoints(scans, noise, weights.model_sigma)?;
    if weights.poses == Poses::Refined {
        viewpoints.iter_mut().for_each(|viewpoint| viewpoint.noise.pose = None);
    }
    Ok(viewpoints)
}

/// Puts the returns where the poses say, and tells how far the farthest moved, metres.
fn put(returns: &mut [Return], scans: &[LaserScan], poses: &[Pose]) -> f64 {
    returns.iter_mut().fold(0.0, |farthest: f64, seen| {
        let (pose, before) = (&poses[seen.scan], seen.point);
        seen.direction = pose.direction(scans[seen.scan].bearing(seen.beam));
        seen.point = pose.position() + seen.direction * seen.range;
        farthest.max((seen.point - before).norm())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::returns_of;
    use crate::sim::{Lidar, World, simulate};

    /// A corridor along x, 2 m wide, seen from eight places. People are in the way of one scan each.
    pub(super) fn corridor(people: &[Vec2]) -> (Vec<LaserScan>, Surfels) {
        let lidar = Lidar::of_degrees(541, 270.0);
        let noise = Noise { sigma_x: 0.001, sigma_y: 0.001, sigma_theta: 1e-4, sigma_range: 0.005 };
        let empty = World::room(&[[-4.0, 0.0], [12.0, 0.0], [12.0, 2.0], [-4.0, 2.0]]);
        let scans: Vec<LaserScan> = (0..8)
            .flat_map(|k| {
                let mut world = empty.clone();
                if let Some(p) = people.get(k) {
                    let corner = |x: f64, y: f64| p + Vec2::new(x, y) * 0.2;
                    world.pillars =
                        vec![vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]];
                }
                let turn = if k % 2 == 0 { 0.1 } else { 3.0 };
                simulate(&world, &lidar, &[Pose::new(k as f64 + 0.4, 1.1, turn)], &noise, k as u64)
            })
            .collect();
        let returns = returns_of(&scans);
        let normals = normals::outward(&returns, 0.25);
        let viewpoints = viewpoints(&scans, &noise, 0.005).unwrap();
        let surfels = Surfels::gather(&returns, &normals, &viewpoints, 0.25);
        (scans, surfels)
    }

    #[test]
    fn the_field_of_a_corridor_is_the_way_from_its_nearer_wall() {
        let (scans, _) = corridor(&[]);
        let noise = Noise { sigma_x: 0.001, sigma_y: 0.001, sigma_theta: 1e-4, sigma_range: 0.005 };
        let bounds = crate::geometry::Bounds { min: [-0.5, -0.5], max: [8.5, 2.5] };
        let lattice = Lattice::covering(&bounds, 0.25, 10_000).unwrap();
        let fit = fit_vector(&scans, &noise, &lattice, &FitOptions::default(), &mut |_| ControlFlow::Continue(()));
        let fit = fit.unwrap();
        assert!(fit.converged && fit.minimum.relative_gradient < 1e-10);
        for (x, y) in [(1.0, 0.0), (2.3, 0.4), (4.1, 0.6), (5.0, 2.0), (6.2, 1.5)] {
            let v = [0, 1].map(|axis: usize| fit.field[axis].value(Vec2::new(x, y)).unwrap());
            let exact = if y < 1.0 { y } else { y - 2.0 };
            assert!(v[0].abs() < 0.03 && (v[1] - exact).abs() < 0.02, "({x}, {y}): {v:?}");
        }
        assert!(fit.seen_through < 0.05, "{} of the returns", fit.seen_through);
    }
}
