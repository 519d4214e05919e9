//! Where a robot is: poses from scans and a map that is itself uncertain.
//!
//! A pose `q = (x, y, theta)` minimises
//!
//! ```text
//! sum over returns of rho(r^2 / R)  +  (q - q0)^T P^-1 (q - q0)  +  motions between scans        (`descent`)
//! ```
//!
//! where `r` is how far a return lies across the surface that it should have met (`sighting`), `R` the range's noise as seen
//! across it and what a surface strays from the spline, and `rho` Geman and McClure's robust loss: people and what was moved
//! are not on the map. With `J` the residuals' derivatives by the poses and `Lambda = J^T R^-1 J + P^-1`,
//!
//! ```text
//! covariance = Lambda^-1 + Lambda^-1 M C M^T Lambda^-1,   M = J^T R^-1 G
//! ```
//!
//! `G` being the residuals' derivatives by the map's coefficients and `C` their covariance (`shared`): the map's error is not
//! noise of each beam, all returns and all scans of a trajectory share it, and it does not average out (Schmidt 1966: a
//! consider state). Taken as fresh noise it would make sigma shrink to nothing along a trajectory.
//!
//! Without a prior a pose is looked for all over the map (`search`), refined from several starts and weighed
//! (`hypotheses`).

mod descent;
mod hypotheses;
mod motion;
mod prior;
mod search;
mod shared;
mod sighting;

use nalgebra::DMatrix;
use thiserror::Error;

pub use hypotheses::Hypothesis;
pub use motion::Motion;
pub use prior::Prior;
pub use search::Ground;

use self::descent::{Course, Descent};
use self::hypotheses::{Ranked, ranked};
use crate::geometry::{Cov3, Pose};
use crate::map::FittedMap;
use crate::scan::LaserScan;
use crate::uncertainty::{Joint, Kind, UncertaintyError};

#[derive(Debug, Error)]
pub enum LocalizeError {
    #[error("{count} motions for {scans} scans; there must be one fewer")]
    Motions { count: usize, scans: usize },
    #[error("the covariance of motion {0} is not positive definite")]
    MotionCovariance(usize),
    #[error("cancelled")]
    Cancelled,
    #[error(transparent)]
    Uncertainty(#[from] UncertaintyError),
}

/// A scan to be located: its own `pose` is not looked at.
#[derive(Debug, Clone)]
pub struct Sighted {
    pub scan: LaserScan,
    /// What is known of its pose beforehand; `None` is anywhere on the map.
    pub prior: Option<Prior>,
    /// The standard deviation of its ranges, metres.
    pub sigma_range: f64,
}

/// Where a scan was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// `None` where the scan fits nowhere; metres and radians, in the map's frame.
    pub pose: Option<Pose>,
    /// Of (x, y, theta), the map's own uncertainty included.
    pub covariance: Option<Cov3>,
    /// Returns that agree with the map, and those that do not or lie where nobody looked.
    pub used: usize,
    pub left_out: usize,
    pub chi_squared: f64,
    pub degrees_of_freedom: usize,
    /// The best first, as many as were asked for.
    pub hypotheses: Vec<Hypothesis>,
}

/// A map that scans are located on.
pub struct Localizer<'a> {
    map: &'a FittedMap,
    ground: &'a Ground,
    joint: &'a Joint,
    kind: Kind,
}

impl<'a> Localizer<'a> {
    /// `ground` and `joint` are the map's; both may be kept for the next scans.
    pub fn new(map: &'a FittedMap, ground: &'a Ground, joint: &'a Joint, kind: Kind) -> Self {
        Self { map, ground, joint, kind }
    }

    /// Locates scans, each by itself. `go_on` says whether to go on.
    pub fn each(
        &self,
        scans: &[Sighted],
        hypotheses: usize,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Vec<Located>, LocalizeError> {
        let mut located = Vec::new();
        for some in scans.chunks(AT_ONCE) {
            let mut courses = Vec::new();
            for sighted in some {
                let found = self.candidates(sighted, go_on)?;
                courses.push(ranked(self.map, std::slice::from_ref(sighted), &[], found));
            }
            located.extend(self.answers(&courses, hypotheses, go_on)?);
        }
        Ok(located)
    }

    /// Locates scans along one trajectory: motion `k` is from scan `k` to the next, in the frame of scan `k`.
    pub fn along(
        &self,
        scans: &[Sighted],
        motions: &[Motion],
        hypotheses: usize,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Vec<Located>, LocalizeError> {
        if motions.len() + 1 != scans.len() {
            return Err(LocalizeError::Motions { count: motions.len(), scans: scans.len() });
        }
        let descent = Descent::new(self.map, scans, motions)?;
        let mut courses = Vec::new();
        for first in self.candidates(&scans[0], go_on)?.into_iter().take(MOST_COURSES) {
            courses.push(descent.settle(descent.approach(motion::chain(first.poses[0], motions), go_on)?, go_on)?);
        }
        self.answers(&[ranked(self.map, scans, motions, courses)], hypotheses, go_on)
    }

    /// Where a scan may have been taken, refined from every start.
    fn candidates(&self, sighted: &Sighted, go_on: &dyn Fn() -> bool) -> Result<Vec<Course>, LocalizeError> {
        let alone = std::slice::from_ref(sighted);
        let descent = Descent::new(self.map, alone, &[])?;
        let mut near: Vec<Pose> = Vec::new();
        for start in self.ground.starts(sighted) {
            let pose = descent.approach(vec![start], go_on)?[0];
            if !near.iter().any(|other| hypotheses::is_same(other, &pose)) {
                near.push(pose);
            }
        }
        near.into_iter().map(|pose| descent.settle(vec![pose], go_on)).collect()
    }
}

impl Localizer<'_> {
    /// The scans of each course, the most probable of those that were found, with as many hypotheses as were asked for.
    fn answers(
        &self,
        found: &[Vec<Ranked>],
        hypotheses: usize,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Vec<Located>, LocalizeError> {
        let is_somewhere = |ranked: &&[Ranked]| ranked[0].0.settled && ranked[0].0.holds();
        let found = || found.iter().map(Vec::as_slice).filter(|ranked| !ranked.is_empty());
        let somewhere: Vec<&Course> = found().filter(is_somewhere).map(|ranked| &ranked[0].0).collect();
        let mut covariances = shared::covariances(self.map, self.joint, self.kind, &somewhere, go_on)?.into_iter();
        let mut located = Vec::new();
        for ranked in found() {
            let covariance = if is_somewhere(&ranked) { covariances.next().flatten() } else { None };
            located.extend((0..ranked[0].0.poses.len()).map(|k| answer(ranked, k, covariance.as_ref(), hypotheses)));
        }
        Ok(located)
    }
}

/// What is said of a scan of the most probable course; `covariance` is of all its scans, and `None` where it is nowhere.
fn answer(ranked: &[Ranked], scan: usize, covariance: Option<&DMatrix<f64>>, hypotheses: usize) -> Located {
    let (best, _) = &ranked[0];
    let fit = &best.fits[scan];
    let own = covariance.map(|all| Cov3::from_fn(|a, b| all[(3 * scan + a, 3 * scan + b)]));
    let known = ranked.iter().take(if own.is_some() { hypotheses } else { 0 });
    let of = |(course, probability): &Ranked| Hypothesis { pose: course.poses[scan], probability: *probability };
    Located {
        pose: own.map(|_| best.poses[scan]),
        covariance: own,
        used: fit.used.len(),
        left_out: fit.left_out,
        chi_squared: fit.chi_squared,
        degrees_of_freedom: fit.used.len().saturating_sub(3),
        hypotheses: known.map(of).collect(),
    }
}

/// Scans whose covariances are formed together: the map's factor is read once for them.
pub const AT_ONCE: usize = 8;
/// Courses of a trajectory that are followed to its end.
const MOST_COURSES: usize = 12;
