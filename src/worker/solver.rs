//! From a request to a map, and how far it has come.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::jobs::{JobRequest, Progress};
use crate::map::{FittedMap, Stage, Step, SurveyError};
use crate::sparse::Team;

/// What the fit and its covariance take of the whole, in per cent: little is before them, and little after.
pub(super) const WHOLE: (f64, f64) = (1.0, 97.0);

/// Who follows a fit, and may end it.
pub struct Follower<'a> {
    /// Kept up to date.
    pub progress: &'a Mutex<Progress>,
    /// Ends the work within a step once it is set.
    pub stop: &'a AtomicBool,
    /// Told at every step which stage it belongs to.
    pub stage: &'a dyn Fn(Stage),
    /// Who shares the work.
    pub team: Team,
}

/// What makes maps of requests. There is one; tests have others, which panic, or do not end.
pub trait Solver: Send + Sync {
    /// A map and its covariance; see [`Follower`].
    fn map_of(&self, request: &JobRequest, follower: &Follower<'_>) -> Result<FittedMap, SurveyError>;
}

/// [`fit_request`].
pub(super) struct Fit;

impl Solver for Fit {
    fn map_of(&self, request: &JobRequest, follower: &Follower<'_>) -> Result<FittedMap, SurveyError> {
        fit_request(request, follower)
    }
}

/// The fit and its covariance; see [`Follower`].
pub fn fit_request(request: &JobRequest, follower: &Follower<'_>) -> Result<FittedMap, SurveyError> {
    let observer = |step: &Step| {
        (follower.stage)(step.stage);
        report(follower.progress, step);
        if follower.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    request.survey().team(follower.team.clone()).map_watched(&observer)
}

fn report(progress: &Mutex<Progress>, step: &Step) {
    let mut progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
    let percent = WHOLE.0 + (WHOLE.1 - WHOLE.0) * step.share;
    progress.percent = progress.percent.max((10.0 * percent).round() / 10.0);
    progress.stage = match step.stage {
        Stage::Fitting => "fitting".into(),
        Stage::Covariance => "covariance".into(),
    };
    progress.iteration = step.fit.iteration;
    progress.max_iterations = step.fit.max_iterations;
    progress.objective = Some(step.fit.objective).filter(|value| value.is_finite());
}
