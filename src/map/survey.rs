//! The front door: from scans to a map.

use std::ops::ControlFlow;
use std::time::Instant;

use thiserror::Error;

use super::{FittedMap, MapError};
use crate::fit::{self, Distance, End, Estimate, FitError, FitOptions, Poses, pose_unknowns};
use crate::geometry::Bounds;
use crate::scan::{LaserScan, Noise, returns_of};
use crate::sparse::Team;
use crate::spline::{Lattice, LatticeError};
use crate::uncertainty::UncertaintyError;

/// Control points a survey's lattice has at most, unless told otherwise.
const MOST_CONTROL_POINTS: usize = 1_000_000;
/// Cells around what was met, where no bounds are given.
const MARGIN: f64 = 3.0;

/// Why a survey gave no map.
#[derive(Debug, Error)]
pub enum SurveyError {
    #[error("no beam of any scan has a return")]
    NoReturns,
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error(transparent)]
    Map(#[from] MapError),
}

impl SurveyError {
    /// Whether the survey was told to stop.
    pub fn is_cancelled(&self) -> bool {
        matches!(self, Self::Fit(FitError::Cancelled) | Self::Map(MapError::Uncertainty(UncertaintyError::Cancelled)))
    }
}

/// What a survey is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    Fitting,
    Covariance,
}

/// Where a survey stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    pub stage: Stage,
    /// The share of the whole that is done, about in proportion to time.
    pub share: f64,
    /// The fit's last step.
    pub fit: fit::Progress,
}

/// Scans, and the map wanted of them.
#[derive(Debug, Clone)]
pub struct Survey<'a> {
    scans: &'a [LaserScan],
    noise: Noise,
    distance: Distance,
    resolution: f64,
    bounds: Option<Bounds>,
    lattice: Option<Lattice>,
    options: FitOptions,
    team: Team,
}

impl<'a> Survey<'a> {
    /// A signed map of the scans at 0.2 m, unless told otherwise.
    pub fn new(scans: &'a [LaserScan], noise: Noise) -> Self {
        let options = FitOptions::default();
        Self {
            scans,
            noise,
            distance: Distance::Signed,
            resolution: 0.2,
            bounds: None,
            lattice: None,
            options,
            team: Team::of_this_machine(),
        }
    }

    /// Which distance the map holds.
    pub fn distance(self, distance: Distance) -> Self {
        Self { distance, ..self }
    }

    /// The spacing of control points, metres.
    pub fn resolution(self, resolution: f64) -> Self {
        Self { resolution, ..self }
    }

    /// The area to map, metres; without it, what the scans met and where they were taken from, and three cells around.
    pub fn bounds(self, bounds: Bounds) -> Self {
        Self { bounds: Some(bounds), ..self }
    }

    /// The lattice itself, in place of resolution and bounds.
    pub fn lattice(self, lattice: Lattice) -> Self {
        Self { lattice: Some(lattice), ..self }
    }

    /// How to fit.
    pub fn options(self, options: FitOptions) -> Self {
        Self { options, ..self }
    }

    /// Which threads share the work; without it, one a core. The map is the same to the last bit.
    pub fn team(self, team: Team) -> Self {
        Self { team, ..self }
    }

    /// The map.
    pub fn map(&self) -> Result<FittedMap, SurveyError> {
        self.map_watched(&|_| ControlFlow::Continue(()))
    }

    /// The map, with an observer that is told every step and may stop it there.
    pub fn map_watched(&self, observer: &dyn Fn(&Step) -> ControlFlow<()>) -> Result<FittedMap, SurveyError> {
        let began = Instant::now();
        let lattice = self.laid_out()?;
        let fits_share = self.fits_share();
        let last = std::cell::Cell::new(fit::Progress::NONE);
        let tolerance = self.options.tolerance;
        let mut watch = |progress: &fit::Progress| {
            last.set(*progress);
            let share = fits_share * progress.share(tolerance);
            observer(&Step { stage: Stage::Fitting, share, fit: *progress })
        };
        let estimate =
            fit::fit(self.scans, &self.noise, self.distance, &lattice, &self.options, &self.team, &mut watch)?;
        let fitted = began.elapsed().as_secs_f64();
        let go_on = |share: f64| {
            let share = fits_share + (1.0 - fits_share) * share;
            observer(&Step { stage: Stage::Covariance, share, fit: last.get() }).is_continue()
        };
        let mut map = FittedMap::of(estimate, self.noise, &go_on)?;
        map.report.seconds = began.elapsed().as_secs_f64();
        map.report.stages = super::StageSeconds { fitting: fitted, covariance: map.report.seconds - fitted };
        Ok(map)
    }

    /// The fit's end, found again: what is not kept with a map is formed from there. `map` is this survey's.
    pub fn resume(&self, map: &FittedMap) -> Result<Estimate, SurveyError> {
        self.resume_while(map, &|| true)
    }

    /// The same; `go_on` says whether to go on.
    pub fn resume_while(&self, map: &FittedMap, go_on: &dyn Fn() -> bool) -> Result<Estimate, SurveyError> {
        let (coefficients, poses) = map.resume_from();
        let reported: Vec<f64>;
        let mut positive_definite = Some(map.report.positive_definite);
        let poses = match (poses, map.report.weights.poses) {
            // Maps of the first format do not say where their fit's last round began; their poses are next to it.
            ([], Poses::Refined) => {
                positive_definite = None;
                reported = pose_unknowns(self.scans, &self.noise, &map.poses)?;
                &reported
            }
            (poses, _) => poses,
        };
        let end = End { coefficients: &coefficients, poses, positive_definite };
        let lattice = map.lattice();
        Ok(fit::resume(self.scans, &self.noise, self.distance, lattice, &self.options, &self.team, (end, go_on))?)
    }

    fn laid_out(&self) -> Result<Lattice, SurveyError> {
        if let Some(lattice) = &self.lattice {
            return Ok(lattice.clone());
        }
        let bounds = match self.bounds {
            Some(bounds) => bounds,
            None => {
                let returns = returns_of(self.scans).into_iter().map(|seen| seen.point);
                let mut met = returns.peekable();
                let _ = met.peek().ok_or(SurveyError::NoReturns)?;
                let stood = self.scans.iter().map(|scan| scan.pose.position());
                Bounds::around(met.chain(stood)).ok_or(SurveyError::NoReturns)?.grown(MARGIN * self.resolution)
            }
        };
        Ok(Lattice::covering(&bounds, self.resolution, MOST_CONTROL_POINTS)?)
    }

    /// The fit's share of the time, about: a signed one takes tens of factorisations, a vector one a few, and the
    /// covariance costs about eight.
    fn fits_share(&self) -> f64 {
        match (self.distance, self.options.poses) {
            (Distance::Signed, _) => 0.8,
            (Distance::Vector, Some(Poses::Fixed)) => 0.2,
            (Distance::Vector, _) => 0.5,
        }
    }
}
