//! The minimum nearest to a start: iteratively reweighted Gauss-Newton, coarse to fine.
//!
//! The robust loss is Geman and McClure's, `rho(u) = u / (1 + u / BULK)`, whose weight is `(1 + u / BULK)^-2`; `u = r^2 / (R +
//! s^2)`. The scale `s` falls in stages, from how far off a start may be to nothing: at half a metre a wall pulls from
//! across a corridor, at the end nothing but what lies on it does. All scans of a trajectory are unknowns together, so
//! what a later scan tells, an earlier pose knows.

use nalgebra::{DMatrix, DVector, Vector3};

use super::motion::{Motion, misfit};
use super::sighting::{Beam, Met, Sighting};
use super::{LocalizeError, Sighted};
use crate::geometry::{Cov3, Pose, wrap_angle};
use crate::map::FittedMap;

/// By stage: the scale, metres, and steps at most.
const APPROACH: [(f64, usize); 4] = [(0.5, 4), (0.2, 4), (0.08, 4), (0.03, 4)];
const LAST: (f64, usize) = (0.0, 24);
/// `BULK`: residuals within three sigmas count nearly whole.
const BULK: f64 = 9.0;
/// A return farther off than so many sigmas does not agree with the map.
const AGREES: f64 = 3.0;
/// How far a surface is looked for, in scales, and at least, metres.
const REACH: (f64, f64) = (3.0, 0.3);
/// Beams of a scan that the coarse stages look at.
const COARSE_BEAMS: usize = 60;
/// A step is no longer than this: metres, radians.
const LONGEST_STEP: (f64, f64) = (0.3, 0.15);
/// Steps shorter than this many metres or radians end a stage; where returns go from one facet to the next and back, the
/// last steps need not shrink: below the second number the descent has settled all the same.
const STILL: f64 = 1e-6;
const SETTLED: f64 = 2e-3;
/// A coarse stage ends where steps are shorter than this share of its scale.
const COARSELY: f64 = 0.02;
/// What beams meet is looked for anew after a motion of this share of the scale, or of the second number, metres.
const STALE: f64 = 0.25;
const FINE: f64 = 0.04;
/// The first scale is at most so many times how far a prior's sigma moves returns.
const WIDE: f64 = 2.0;
/// What a turn moves is taken to be so far away, metres.
const ARM: f64 = 5.0;
/// A scan of which something is known beforehand fits where it agrees this well with the map, one from nowhere where this
/// well: all 46 of Intel's held-out scans and all 8 of Seattle's do on their maps, 2 of 40 of another building's on Intel's
/// and none of 11 on Seattle's (`examples/localization.rs`).
const FITS: (f64, f64) = (0.45, 0.75);
const LEAST_RETURNS: usize = 8;

/// What is minimised.
pub struct Descent<'a> {
    map: &'a FittedMap,
    scans: &'a [Sighted],
    beams: Vec<Vec<Beam>>,
    motions: &'a [Motion],
    /// The motions' inverse covariances.
    informations: Vec<Cov3>,
}

/// Where a descent ended.
#[derive(Debug, Clone)]
pub struct Course {
    pub poses: Vec<Pose>,
    /// `Lambda`, three unknowns a scan.
    pub information: DMatrix<f64>,
    pub fits: Vec<Agreement>,
    /// Whether the last step was next to none.
    pub settled: bool,
    /// Whether nothing was known of its first pose beforehand.
    anywhere: bool,
}

/// How a scan agrees with the map.
#[derive(Debug, Clone)]
pub struct Agreement {
    pub used: Vec<Used>,
    pub left_out: usize,
    pub chi_squared: f64,
    /// By what its returns' variance is multiplied, so that they scatter as they should.
    pub excess: f64,
}

/// A return that agrees, and its weight: the loss's over its variance.
#[derive(Debug, Clone)]
pub struct Used {
    pub sighting: Sighting,
    pub weight: f64,
    /// Square metres.
    variance: f64,
}

impl Agreement {
    /// How well the scan agrees: the mean over its returns of the loss's `1 / (1 + u / BULK)`, none of those left out.
    fn share(&self) -> f64 {
        let own = |used: &Used| (used.weight * used.variance).sqrt();
        self.used.iter().map(own).sum::<f64>() / (self.used.len() + self.left_out).max(1) as f64
    }
}

impl Course {
    /// Whether its scans were taken there: most of them, where there are several.
    pub fn holds(&self) -> bool {
        let least = if self.anywhere { FITS.1 } else { FITS.0 };
        let holds = |fit: &Agreement| fit.used.len() >= LEAST_RETURNS && fit.share() >= least;
        2 * self.fits.iter().filter(|fit| holds(fit)).count() > self.fits.len()
    }
}

/// What beams met when a scan was at a pose, by their index.
struct Look {
    from: Pose,
    met: Vec<(usize, Met)>,
}

impl Look {
    /// How far returns have moved since, about, metres.
    fn moved(&self, pose: &Pose) -> f64 {
        (pose.position() - self.from.position()).norm() + ARM * wrap_angle(pose.theta - self.from.theta).abs()
    }
}

/// Normal equations.
struct Normal {
    information: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl<'a> Descent<'a> {
    pub fn new(map: &'a FittedMap, scans: &'a [Sighted], motions: &'a [Motion]) -> Result<Self, LocalizeError> {
        let informations = motions.iter().enumerate().map(|(k, motion)| motion.information(k));
        let beams = scans.iter().map(|sighted| {
            let scan = &sighted.scan;
            let beam = |k| Some(Beam { bearing: scan.bearing(k), range: scan.range(k)? });
            (0..scan.ranges.len()).filter_map(beam).collect()
        });
        Ok(Self { map, scans, beams: beams.collect(), motions, informations: informations.collect::<Result<_, _>>()? })
    }

    /// From a start, a pose a scan, to where all but the last stage end. `go_on` says whether to go on.
    pub fn approach(&self, mut poses: Vec<Pose>, go_on: &dyn Fn() -> bool) -> Result<Vec<Pose>, LocalizeError> {
        let level = vec![1.0; poses.len()];
        for (scale, steps) in APPROACH.into_iter().filter(|(scale, _)| *scale <= self.widest()) {
            self.stage(&mut poses, (scale, steps), &level, go_on)?;
        }
        Ok(poses)
    }

    /// From where [`Descent::approach`] ended. `go_on` says whether to go on.
    pub fn settle(&self, mut poses: Vec<Pose>, go_on: &dyn Fn() -> bool) -> Result<Course, LocalizeError> {
        let level = vec![1.0; poses.len()];
        let mut settled = self.stage(&mut poses, LAST, &level, go_on)?;
        // Returns that scatter more than they should are worth less, beside the prior and the motions.
        let excess: Vec<f64> = self.agreements(&poses, &level).iter().map(|own| own.excess).collect();
        if excess.iter().any(|own| *own > 1.0) {
            settled = self.stage(&mut poses, LAST, &excess, go_on)?;
        }
        let fits = self.agreements(&poses, &excess);
        let mut normal = self.priors(&poses);
        for (k, fit) in fits.iter().enumerate() {
            fit.used.iter().for_each(|used| normal.add(k, used, 0.0));
        }
        let anywhere = self.scans[0].prior.is_none();
        Ok(Course { poses, information: normal.information, fits, settled, anywhere })
    }

    /// What beams meet is looked for anew where a pose has moved, and where the steps have ended but not since.
    fn stage(
        &self,
        poses: &mut [Pose],
        (scale, steps): (f64, usize),
        excess: &[f64],
        go_on: &dyn Fn() -> bool,
    ) -> Result<bool, LocalizeError> {
        let still = if scale > 0.0 { COARSELY * scale } else { STILL };
        let mut looks: Vec<Look> = poses.iter().enumerate().map(|(k, pose)| self.look(k, pose, scale)).collect();
        let mut longest = f64::INFINITY;
        for _ in 0..steps {
            let mut normal = self.priors(poses);
            for (k, pose) in poses.iter().enumerate() {
                if !go_on() {
                    return Err(LocalizeError::Cancelled);
                }
                self.add_returns(&mut normal, (k, pose), &looks[k], (scale, excess[k]));
            }
            let Some(factor) = normal.information.cholesky() else { return Ok(false) };
            let step = factor.solve(&normal.gradient);
            longest = 0.0;
            for (k, pose) in poses.iter_mut().enumerate() {
                let own = shortened(Vector3::new(step[3 * k], step[3 * k + 1], step[3 * k + 2]));
                *pose = Pose::new(pose.x - own.x, pose.y - own.y, wrap_angle(pose.theta - own.z));
                longest = longest.max(own.amax());
            }
            let allowed = if longest < still { still } else { STALE * scale.max(FINE) };
            let mut is_new = false;
            for (k, pose) in poses.iter().enumerate() {
                if looks[k].moved(pose) > allowed {
                    (looks[k], is_new) = (self.look(k, pose, scale), true);
                }
            }
            if longest < still && !is_new {
                break;
            }
        }
        Ok(longest < SETTLED)
    }

    /// The widest scale that is needed: a scan of which much is known beforehand is not looked for far away.
    fn widest(&self) -> f64 {
        match self.scans {
            [Sighted { prior: Some(prior), .. }] => {
                let sigma = |k| prior.covariance[(k, k)].max(0.0).sqrt();
                WIDE * (sigma(0).max(sigma(1)) + ARM * sigma(2)).max(FINE)
            }
            _ => f64::INFINITY,
        }
    }

    /// What a scan's beams meet from a pose; of the coarse stages' few beams.
    fn look(&self, scan: usize, pose: &Pose, scale: f64) -> Look {
        let beams = &self.beams[scan];
        let skip = if scale > 0.0 { beams.len().div_ceil(COARSE_BEAMS).max(1) } else { 1 };
        let reach = (REACH.0 * scale).max(REACH.1);
        let some = beams.iter().enumerate().step_by(skip);
        let met = some.filter_map(|(k, beam)| Some((k, Met::of(self.map, pose, beam, reach)?)));
        Look { from: *pose, met: met.collect() }
    }

    fn add_returns(&self, normal: &mut Normal, (k, pose): (usize, &Pose), look: &Look, (scale, excess): (f64, f64)) {
        let resolution = self.map.lattice().resolution;
        for &(beam, met) in &look.met {
            let Some(sighting) = Sighting::of(self.map, pose, &self.beams[k][beam], met) else { continue };
            let variance = excess * sighting.variance(self.scans[k].sigma_range, resolution) + scale * scale;
            let u = sighting.residual.powi(2) / variance;
            let weight = (1.0 + u / BULK).powi(-2) / variance;
            normal.add(k, &Used { sighting, weight, variance }, sighting.residual);
        }
    }

    /// What priors and motions say.
    fn priors(&self, poses: &[Pose]) -> Normal {
        let n = 3 * poses.len();
        let mut normal = Normal { information: DMatrix::zeros(n, n), gradient: DVector::zeros(n) };
        for (k, sighted) in self.scans.iter().enumerate() {
            if let Some(prior) = &sighted.prior {
                normal.add_block((k, k), prior.information());
                normal.pull(k, &(prior.information() * prior.offset(&poses[k])));
            }
        }
        for (k, (motion, information)) in self.motions.iter().zip(&self.informations).enumerate() {
            let (off, by_before, by_after) = misfit(motion, &poses[k], &poses[k + 1]);
            for (a, by_a) in [(k, by_before), (k + 1, by_after)] {
                normal.pull(a, &(by_a.transpose() * information * off));
                for (b, by_b) in [(k, by_before), (k + 1, by_after)] {
                    normal.add_block((a, b), &(by_a.transpose() * information * by_b));
                }
            }
        }
        // A pose of which nothing is known beforehand is somewhere on the map.
        let [width, height] = self.map.lattice().bounds().size();
        let anywhere = [width, height, std::f64::consts::TAU].map(|span| 12.0 / span.powi(2));
        for (k, _) in self.scans.iter().enumerate().filter(|(_, sighted)| sighted.prior.is_none()) {
            normal.add_block((k, k), &Cov3::from_diagonal(&anywhere.into()));
        }
        normal
    }

    fn agreements(&self, poses: &[Pose], excess: &[f64]) -> Vec<Agreement> {
        let resolution = self.map.lattice().resolution;
        let own = |(k, pose): (usize, &Pose)| {
            let mut agreement = Agreement { used: Vec::new(), left_out: 0, chi_squared: 0.0, excess: 1.0 };
            for beam in &self.beams[k] {
                let met = Met::of(self.map, pose, beam, REACH.1);
                let Some(sighting) = met.and_then(|met| Sighting::of(self.map, pose, beam, met)) else {
                    agreement.left_out += 1;
                    continue;
                };
                let variance = excess[k] * sighting.variance(self.scans[k].sigma_range, resolution);
                let u = sighting.residual.powi(2) / variance;
                if u > AGREES * AGREES {
                    agreement.left_out += 1;
                } else {
                    agreement.chi_squared += u;
                    let weight = (1.0 + u / BULK).powi(-2) / variance;
                    agreement.used.push(Used { sighting, weight, variance });
                }
            }
            let degrees = agreement.used.len().saturating_sub(3).max(1) as f64;
            agreement.excess = excess[k] * (agreement.chi_squared / degrees).max(1.0);
            agreement
        };
        poses.iter().enumerate().map(own).collect()
    }
}

impl Normal {
    fn add(&mut self, scan: usize, used: &Used, residual: f64) {
        let by_pose = used.sighting.by_pose;
        self.add_block((scan, scan), &(by_pose * by_pose.transpose() * used.weight));
        self.pull(scan, &(by_pose * (used.weight * residual)));
    }

    fn add_block(&mut self, (a, b): (usize, usize), block: &Cov3) {
        let mut view = self.information.fixed_view_mut::<3, 3>(3 * a, 3 * b);
        view += block;
    }

    fn pull(&mut self, scan: usize, gradient: &Vector3<f64>) {
        let mut view = self.gradient.fixed_rows_mut::<3>(3 * scan);
        view += gradient;
    }
}

fn shortened(step: Vector3<f64>) -> Vector3<f64> {
    let longest = (step.xy().norm() / LONGEST_STEP.0).max(step.z.abs() / LONGEST_STEP.1);
    if longest > 1.0 { step / longest } else { step }
}
