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
mod inputs;
mod objective;

use std::ops::ControlFlow;
use std::sync::Arc;

use characteristics::Characteristics;
use inputs::VectorInputs;
use objective::VectorObjective;

use super::estimate::{Distance, Estimate, Minimum, missed_by};
use super::gauge::Motions;
use super::options::{FitOptions, MOST_TRUST, Poses, Weighting, Weights};
use super::surfels::{Surfel, Surfels, normals, standing};
use super::system::Factor;
use super::viewpoint::{Viewpoint, corrected, information, range_sigma, returns_inside, viewpoints};
use super::{End, FitError, Job, Observer, Progress, in_use, why_not};
use crate::geometry::Pose;
use crate::scan::{LaserScan, Noise, Return};
use crate::sparse::{Cholesky, Pattern, Stencil, Team};
use crate::spline::Lattice;

/// Control points are in use where evidence is at most this many cells away, unless the request has a band.
pub(super) const DEFAULT_BAND: f64 = 0.5;
/// Where poses are refined, returns may move by so many of their standard deviations and stay on the map, up to so many
/// cells.
const BAND_SIGMAS: f64 = 2.0;
const WIDEST_BAND: f64 = 5.0;
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
const MOST_ROUNDS: usize = 4;
/// Surfels are as good as gathered around the poses where this share of the returns moves by less than so many cells.
const SETTLED_SHARE: f64 = 0.98;
const SETTLED: f64 = 0.02;
/// Steps on the way to the minimum for surfels as they were last gathered, at most.
const MOST_STEPS: usize = 20;

/// Fits a vector distance function.
pub(super) fn fit(job: &Job<'_>, observer: Observer<'_>) -> Result<Estimate, FitError> {
    let &Job { scans, noise, lattice, options, .. } = job;
    let mut returns = returns_inside(scans, lattice)?;
    let weights = vector_weights(options, lattice, information(lattice, &returns, range_sigma(scans, noise, &returns)));
    let viewpoints = viewpoints_of(scans, noise, &weights)?;
    let mut evidence = job.evidence(observer)?;
    let refined = weights.poses == Poses::Refined;
    let default_band = match refined {
        true => DEFAULT_BAND.max(BAND_SIGMAS * farthest_sigma(&viewpoints) / lattice.resolution).min(WIDEST_BAND),
        false => DEFAULT_BAND,
    };
    let band = options.band.unwrap_or(default_band);
    let near = evidence.cells_within(lattice, band.min(default_band));
    let stencil = Stencil::of_cells(lattice, &evidence.cells_within(lattice, band));
    let team = job.team;
    let place =
        Place { scans, lattice, viewpoints: &viewpoints, weights: &weights, near: &near, stencil: &stencil, team };
    let mut cholesky = job.cholesky(&stencil)?;

    let (mut gathered, mut z) = match job.end {
        Some(end) => place.ended(end, &mut returns)?,
        None => place.rounds(&mut returns, options, &mut cholesky, observer)?,
    };
    let (objective, minimum) = match job.end {
        Some(_) => place.assembled(&mut gathered, &z, cholesky.pattern())?,
        None => place.settled(&mut gathered, &mut z, options, &mut cholesky, observer)?,
    };
    let e = z.split_off(2 * lattice.len());
    put(&mut returns, scans, &corrected(scans, &viewpoints, &e));
    let round = gathered;
    evidence.replace_surfaces(lattice, round.surfels.all.iter().map(Surfel::ends));
    let converged = minimum.relative_gradient <= options.tolerance;
    let y = z.split_off(lattice.len());
    let field = [in_use(lattice, &stencil, z), in_use(lattice, &stencil, y)];
    let taken = returns.iter().zip(&round.stands).filter(|(_, stands)| **stands);
    let rms = missed_by(&field, taken.map(|(seen, _)| seen.point));
    let inputs = VectorInputs {
        field: field.clone(),
        surfels: round.surfels.clone(),
        stencil: stencil.clone(),
        model_sigma: weights.model_sigma,
        refined,
    };
    Ok(Estimate {
        distance: Distance::Vector,
        weighting: Weighting::Calibrated,
        lattice: lattice.clone(),
        surfaces: field.into(),
        evidence,
        converged,
        unconverged: why_not(converged, &minimum, options),
        resume: round.e.iter().chain(&e).copied().collect(),
        minimum,
        system: objective.system,
        inputs: Box::new(inputs),
        surfels: Some(round.surfels),
        cholesky,
        returns: returns.iter().map(|seen| seen.point).collect(),
        poses: corrected(scans, &viewpoints, &e),
        cut_locus: Some(round.traced.left_out),
        seen_through: Some(round.seen_through),
        rms,
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
    team: &'a Team,
}

/// Surfels gathered around one set of poses.
struct Gathered {
    /// The pose unknowns they were gathered at.
    e: Vec<f64>,
    surfels: Surfels,
    traced: Characteristics,
    seen_through: f64,
    /// Which of the returns were not.
    stands: Vec<bool>,
    /// How often they had been gathered then.
    round: usize,
}

impl Place<'_> {
    fn refined(&self) -> bool {
        self.weights.poses == Poses::Refined
    }

    fn poses(&self, e: &[f64]) -> Vec<Pose> {
        corrected(self.scans, self.viewpoints, e)
    }

    /// Surfels of returns that lie where the pose unknowns `e` put them.
    fn gather(&self, returns: &[Return], e: &[f64], go_on: &mut dyn FnMut() -> bool) -> Result<Gathered, FitError> {
        let &Self { scans, lattice, viewpoints, near, .. } = self;
        let normals = normals::outward(returns, lattice.resolution);
        let (mut surfels, owners) = Surfels::gather(returns, &normals, viewpoints, lattice.resolution);
        let stands = standing::standing(&surfels, scans, &self.poses(e), lattice.resolution, go_on);
        let stands = stands.ok_or(FitError::Cancelled)?;
        let kept = surfels.keep(&stands);
        // Where nothing stands, everything was kept.
        let stands = owners.iter().map(|own| kept >= 1.0 || stands[*own]).collect();
        let traced = Characteristics::trace(lattice, &surfels, near, self.team);
        Ok(Gathered { e: e.to_vec(), surfels, traced, seen_through: 1.0 - kept, stands, round: 1 })
    }

    /// The objective of gathered surfels, linear around the pose unknowns `e`.
    fn objective(&self, gathered: &Gathered, e: &[f64], before: &Arc<Pattern>) -> Result<VectorObjective, FitError> {
        let gauge = match self.refined() {
            true => Motions::of(self.viewpoints),
            false => Motions::none(e.len()),
        };
        let (&Self { lattice, stencil, weights, .. }, Gathered { surfels, traced, .. }) = (self, gathered);
        Ok(VectorObjective::assemble(lattice, stencil, surfels, traced, weights, (e, gauge), before)?)
    }

    /// Gathers surfels and minimises until poses change little; the last surfels, and the unknowns.
    fn rounds(
        &self,
        returns: &mut [Return],
        options: &FitOptions,
        cholesky: &mut Cholesky,
        observer: Observer<'_>,
    ) -> Result<(Gathered, Vec<f64>), FitError> {
        let rounds = if self.refined() { MOST_ROUNDS.min(options.max_iterations) } else { 1 };
        let mut e = vec![0.0; 3 * self.scans.len()];
        let mut progress = Progress { max_iterations: rounds + 1, ..Progress::NONE };
        loop {
            observe(observer, &progress)?;
            let mut gathered = self.gather(returns, &e, &mut || observer(&progress).is_continue())?;
            gathered.round = progress.iteration + 1;
            observe(observer, &progress)?;
            let objective = self.objective(&gathered, &e, cholesky.pattern())?;
            let factor = Factor::factorise(&objective.system, cholesky)?;
            let downhill: Vec<f64> = objective.system.gradient.iter().map(|slope| -slope).collect();
            let mut z = factor.solve_checked(&objective.system, cholesky, &downhill)?;
            progress.iteration += 1;
            progress.objective = objective.minimum(&z).objective;
            if !self.refined() {
                z[2 * self.lattice.len()..].fill(0.0);
                return Ok((gathered, z));
            }
            e.copy_from_slice(&z[2 * self.lattice.len()..]);
            let settled = put(returns, self.scans, &self.poses(&e)) <= SETTLED * self.lattice.resolution;
            if settled || progress.iteration == rounds {
                return Ok((gathered, z));
            }
        }
    }

    /// The objective linear around the poses as they are, and how well the unknowns minimise it.
    fn assembled(
        &self,
        gathered: &mut Gathered,
        z: &[f64],
        before: &Arc<Pattern>,
    ) -> Result<(VectorObjective, Minimum), FitError> {
        let e = &z[2 * self.lattice.len()..];
        gathered.surfels.reproject(&self.poses(&gathered.e), &self.poses(e), self.viewpoints);
        let objective = self.objective(gathered, e, before)?;
        let minimum = objective.minimum(z);
        Ok((objective, minimum))
    }

    /// Goes on to the minimum for the surfels as they were gathered: chords of the last factor, since little changes but
    /// where the poses turn them.
    fn settled(
        &self,
        gathered: &mut Gathered,
        z: &mut [f64],
        options: &FitOptions,
        cholesky: &mut Cholesky,
        observer: Observer<'_>,
    ) -> Result<(VectorObjective, Minimum), FitError> {
        let (mut factor, mut steps) = (None, 0);
        loop {
            let (objective, minimum) = self.assembled(gathered, z, cholesky.pattern())?;
            let factorisations = gathered.round + usize::from(factor.is_some());
            let minimum = Minimum { iterations: gathered.round + steps, factorisations, ..minimum };
            let progress = Progress { iteration: steps, max_iterations: MOST_STEPS, ..Progress::NONE };
            observe(
                observer,
                &Progress { objective: minimum.objective, relative_gradient: minimum.relative_gradient, ..progress },
            )?;
            if minimum.relative_gradient <= 0.1 * options.tolerance || steps == MOST_STEPS || !self.refined() {
                return Ok((objective, minimum));
            }
            let own = match &factor {
                Some(factor) => factor,
                None => factor.insert(Factor::factorise(&objective.system, cholesky)?),
            };
            let mut step: Vec<f64> = objective.slope(z).iter().map(|slope| -slope).collect();
            own.solve(cholesky, &mut step);
            z.iter_mut().zip(&step).for_each(|(z, step)| *z += step);
            steps += 1;
        }
    }

    /// The surfels and the unknowns of a fit that ended before.
    fn ended(&self, end: End<'_>, returns: &mut [Return]) -> Result<(Gathered, Vec<f64>), FitError> {
        let unknowns = 3 * self.scans.len();
        let (gathered_at, e) = match end.poses.len() {
            len if len == 2 * unknowns => end.poses.split_at(unknowns),
            len if len == unknowns => (end.poses, end.poses),
            _ => return Err(FitError::NotFinite),
        };
        put(returns, self.scans, &self.poses(gathered_at));
        let gathered = self.gather(returns, gathered_at, &mut || true)?;
        let mut z: Vec<f64> =
            end.coefficients.iter().flat_map(|own| own.iter()).map(|c| if c.is_nan() { 0.0 } else { *c }).collect();
        z.extend(e);
        Ok((gathered, z))
    }
}

fn observe(observer: &mut dyn FnMut(&Progress) -> ControlFlow<()>, progress: &Progress) -> Result<(), FitError> {
    if observer(progress).is_break() { Err(FitError::Cancelled) } else { Ok(()) }
}

fn vector_weights(options: &FitOptions, lattice: &Lattice, information: f64) -> Weights {
    let mut weights = Weights::resolve(options, lattice.resolution, information);
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

/// Puts the returns where the poses say, and tells by how much at most [`SETTLED_SHARE`] of them moved, metres.
fn put(returns: &mut [Return], scans: &[LaserScan], poses: &[Pose]) -> f64 {
    let mut moved: Vec<f64> = returns
        .iter_mut()
        .map(|seen| {
            let (pose, before) = (&poses[seen.scan], seen.point);
            seen.direction = pose.direction(scans[seen.scan].bearing(seen.beam));
            seen.point = pose.position() + seen.direction * seen.range;
            (seen.point - before).norm()
        })
        .collect();
    let at = ((moved.len() - 1) as f64 * SETTLED_SHARE) as usize;
    *moved.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::Vec2;
    use crate::scan::returns_of;
    use crate::sim::{Lidar, World, simulate};

    /// A corridor along x, 2 m wide, seen from eight places. People are in the way of one scan each.
    pub(in crate::fit) fn corridor(people: &[Vec2]) -> (Vec<LaserScan>, Surfels) {
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
        let (surfels, _) = Surfels::gather(&returns, &normals, &viewpoints, 0.25);
        (scans, surfels)
    }

    #[test]
    fn the_field_of_a_corridor_is_the_way_from_its_nearer_wall() {
        let (scans, _) = corridor(&[]);
        let noise = Noise { sigma_x: 0.001, sigma_y: 0.001, sigma_theta: 1e-4, sigma_range: 0.005 };
        let bounds = crate::geometry::Bounds { min: [-0.5, -0.5], max: [8.5, 2.5] };
        let lattice = Lattice::covering(&bounds, 0.25, 10_000).unwrap();
        let options = FitOptions::default();
        let job = Job::alone(&scans, &noise, &lattice, &options);
        let fit = fit(&job, &mut |_| ControlFlow::Continue(())).unwrap();
        assert!(fit.converged && fit.minimum.relative_gradient < 1e-10);
        for (x, y) in [(1.0, 0.0), (2.3, 0.4), (4.1, 0.6), (5.0, 2.0), (6.2, 1.5)] {
            let v = [0, 1].map(|axis: usize| fit.surfaces[axis].value(Vec2::new(x, y)).unwrap());
            let exact = if y < 1.0 { y } else { y - 2.0 };
            assert!(v[0].abs() < 0.03 && (v[1] - exact).abs() < 0.02, "({x}, {y}): {v:?}");
        }
        assert!(fit.seen_through < Some(0.05), "{:?} of the returns", fit.seen_through);
    }

    #[test]
    fn the_rms_is_that_of_the_returns_that_stand() {
        let (scans, _) = corridor(&[Vec2::new(2.0, 0.9), Vec2::new(3.0, 1.2)]);
        let noise = Noise { sigma_x: 0.001, sigma_y: 0.001, sigma_theta: 1e-4, sigma_range: 0.005 };
        let bounds = crate::geometry::Bounds { min: [-0.5, -0.5], max: [8.5, 2.5] };
        let lattice = Lattice::covering(&bounds, 0.25, 10_000).unwrap();
        let options = FitOptions::default();
        let fit = fit(&Job::alone(&scans, &noise, &lattice, &options), &mut |_| ControlFlow::Continue(())).unwrap();
        // Ranges are good to 5 mm; the two people stood almost a metre off the walls.
        let all = missed_by(&fit.surfaces, fit.returns.iter().copied());
        assert!(
            fit.rms > 0.002 && fit.rms < 0.02 && all > 2.0 * fit.rms,
            "{} of those that stand, {all} of all",
            fit.rms
        );
    }
}
