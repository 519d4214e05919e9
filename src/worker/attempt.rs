//! One attempt at one job: from the claimed request to a finished map, or to the reason why not.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use thiserror::Error;
use tokio::runtime::Handle;
use uuid::Uuid;

use super::Workshop;
use crate::fit::{self, FitError, Weighting, fit, fit_published_vector, fit_vector};
use crate::jobs::{Distance, JobRequest, MapRecord, ProblemReport, Progress, RequestError};
use crate::map::{ArchiveError, FittedMap, MapError, factors_to_npz};
use crate::store::{Artifacts, ArtifactsError, Claim, MAX_ATTEMPTS, StoreError};
use crate::uncertainty::Factors;

/// How often the lease is renewed and progress carried to the store.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// The first delay before a retry; it doubles with every attempt.
const FIRST_BACKOFF: Duration = Duration::from_secs(1);

#[derive(Debug, Error)]
enum AttemptError {
    #[error("the attempt was told to stop")]
    Stopped,
    #[error("the stored request cannot be read: {0}")]
    Request(#[from] RequestError),
    #[error("the stored request cannot be unpacked: {0}")]
    Unpack(std::io::Error),
    #[error(transparent)]
    Fit(FitError),
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    #[error(transparent)]
    Artifacts(#[from] ArtifactsError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("the solver panicked: {0}")]
    Panic(String),
}

impl From<FitError> for AttemptError {
    fn from(error: FitError) -> Self {
        match error {
            FitError::Cancelled => Self::Stopped,
            other => Self::Fit(other),
        }
    }
}

impl AttemptError {
    /// Whether another attempt may fare better: only where the infrastructure failed.
    fn may_pass(&self) -> bool {
        matches!(self, Self::Artifacts(_) | Self::Store(_) | Self::Panic(_))
    }

    fn problem(&self) -> ProblemReport {
        let (slug, title) = match self {
            Self::Fit(FitError::NoEvidence) => ("no-evidence", "The scans say nothing about the map's area"),
            Self::Fit(_) | Self::Map(_) => ("fit-failed", "The map could not be fitted"),
            Self::Panic(_) => ("solver-panicked", "The solver failed in a way it should not"),
            _ => ("internal-error", "The job could not be finished"),
        };
        ProblemReport {
            r#type: format!("/problems/{slug}"),
            title: title.into(),
            status: if matches!(self, Self::Fit(_) | Self::Map(_)) { 422 } else { 500 },
            detail: self.to_string(),
        }
    }
}

/// Runs a claimed job to its end on this thread.
pub(super) fn run(workshop: &Arc<Workshop>, runtime: &Handle, claim: Claim) {
    let (id, attempt) = (claim.job.id.clone(), claim.job.attempt);
    let stop = workshop.enter(&id);
    let progress = Arc::new(Mutex::new(Progress { stage: "preparing".into(), ..claim.job.progress.clone() }));
    let heart = runtime.spawn(keep_lease(workshop.clone(), id.clone(), attempt, progress.clone(), stop.clone()));
    // A panic in the numerics costs this attempt, not the solver thread.
    let work = std::panic::AssertUnwindSafe(|| work(workshop, runtime, &claim, &progress, &stop));
    let outcome = std::panic::catch_unwind(work).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        Err(AttemptError::Panic(text.unwrap_or_default()))
    });
    heart.abort();
    workshop.leave(&id);
    if let Err(error) = outcome {
        runtime.block_on(settle(workshop, &id, attempt, &error));
    }
}

fn work(
    workshop: &Workshop,
    runtime: &Handle,
    claim: &Claim,
    progress: &Mutex<Progress>,
    stop: &AtomicBool,
) -> Result<(), AttemptError> {
    let json = zstd::decode_all(&claim.request[..]).map_err(AttemptError::Unpack)?;
    let request = JobRequest::parse(&json, &workshop.limits)?;
    drop(json);
    let (map, factors) = fit_request(&request, progress, stop)?;
    set_stage(progress, "storing", 95.0);
    let prefix = Artifacts::prefix(&claim.job.id, claim.job.attempt);
    let files = [("map.npz", map.to_npz()?), ("factors.npz", factors_to_npz(map.lattice(), &factors)?)];
    drop(factors);
    for (name, bytes) in files {
        if stop.load(Ordering::Relaxed) {
            return Err(AttemptError::Stopped);
        }
        runtime.block_on(workshop.artifacts.put(&prefix, name, bytes))?;
    }
    let record = MapRecord {
        id: Uuid::now_v7().to_string(),
        job_id: claim.job.id.clone(),
        tenant: claim.job.tenant.clone(),
        name: claim.job.name.clone(),
        labels: claim.job.labels.clone(),
        created: 0,
        distance: map.field.name().into(),
        lattice: map.lattice().clone(),
        fit: map.report.clone(),
        prefix,
    };
    match runtime.block_on(workshop.records.succeed(claim.job.attempt, &record))? {
        true => Ok(()),
        false => Err(AttemptError::Stopped),
    }
}

/// The fit and its covariance. `progress` is kept up to date; `stop` ends the fit within one step.
pub fn fit_request(
    request: &JobRequest,
    progress: &Mutex<Progress>,
    stop: &AtomicBool,
) -> Result<(FittedMap, Factors), FitFailure> {
    let began = Instant::now();
    let tolerance = request.options.tolerance;
    let mut observer = |step: &fit::Progress| {
        report(progress, step, tolerance);
        if stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let JobRequest { scans, noise, lattice, options, .. } = request;
    let seconds = || began.elapsed().as_secs_f64();
    let covariance_next = || {
        set_stage(progress, "covariance", 85.0);
        if stop.load(Ordering::Relaxed) { Err(FitError::Cancelled) } else { Ok(()) }
    };
    match request.distance {
        Distance::Signed => {
            let fitted = fit(scans, noise, lattice, options, &mut observer)?;
            covariance_next()?;
            Ok(FittedMap::finish(fitted, *noise, seconds)?)
        }
        Distance::Vector if options.weighting == Weighting::Paper => {
            let fitted = fit_published_vector(scans, noise, lattice, options, &mut observer)?;
            covariance_next()?;
            let poses = scans.iter().map(|scan| scan.pose).collect();
            Ok(FittedMap::finish_published_vector(fitted, poses, *noise, seconds)?)
        }
        Distance::Vector => {
            let fitted = fit_vector(scans, noise, lattice, options, &mut observer)?;
            covariance_next()?;
            Ok(FittedMap::finish_vector(fitted, *noise, seconds)?)
        }
    }
}

/// Why [`fit_request`] gave no map.
#[derive(Debug, Error)]
pub enum FitFailure {
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error(transparent)]
    Map(#[from] MapError),
}

impl From<FitFailure> for AttemptError {
    fn from(failure: FitFailure) -> Self {
        match failure {
            FitFailure::Fit(error) => error.into(),
            FitFailure::Map(error) => error.into(),
        }
    }
}

/// The estimate: however many of the allowed steps are done, or of the decades the gradient has to fall.
fn report(progress: &Mutex<Progress>, step: &fit::Progress, tolerance: f64) {
    let by_steps = step.iteration as f64 / step.max_iterations as f64;
    let by_gradient = step.relative_gradient.max(1e-300).log10() / tolerance.log10();
    let mut progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
    let percent = 5.0 + 80.0 * by_steps.max(by_gradient).clamp(0.0, 1.0);
    progress.percent = progress.percent.max((10.0 * percent).round() / 10.0);
    progress.stage = "fitting".into();
    progress.iteration = step.iteration;
    progress.max_iterations = step.max_iterations;
    progress.objective = Some(step.objective);
}

fn set_stage(progress: &Mutex<Progress>, stage: &str, percent: f64) {
    let mut progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
    progress.stage = stage.into();
    progress.percent = progress.percent.max(percent);
}

async fn keep_lease(
    workshop: Arc<Workshop>,
    id: String,
    attempt: i64,
    progress: Arc<Mutex<Progress>>,
    stop: Arc<AtomicBool>,
) {
    let mut beat = tokio::time::interval(HEARTBEAT);
    loop {
        beat.tick().await;
        let now = progress.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match workshop.records.heartbeat(&id, attempt, &now).await {
            Ok(true) => {}
            Ok(false) => {
                tracing::info!(job = %id, attempt, "the lease is lost; the fit stops");
                stop.store(true, Ordering::Relaxed);
                return;
            }
            // A database that is away may be back before the lease lapses.
            Err(error) => tracing::warn!(job = %id, %error, "a heartbeat failed"),
        }
    }
}

/// Says in the store what became of an attempt that has no map.
async fn settle(workshop: &Workshop, id: &str, attempt: i64, error: &AttemptError) {
    let records = &workshop.records;
    let outcome = match error {
        // Draining hands the job back; where the lease is lost this writes nothing.
        AttemptError::Stopped => records.release(id, attempt).await,
        error if error.may_pass() && attempt < MAX_ATTEMPTS => {
            tracing::warn!(job = %id, attempt, %error, "the attempt failed and is retried");
            let delay = FIRST_BACKOFF * 2u32.saturating_pow(attempt.clamp(1, 10) as u32 - 1);
            records.retry(id, attempt, delay, &error.to_string()).await
        }
        error => {
            tracing::warn!(job = %id, attempt, %error, "the job failed");
            records.fail(id, attempt, &error.problem()).await
        }
    };
    if let Err(error) = outcome {
        tracing::error!(job = %id, attempt, %error, "the attempt's end could not be stored; its lease will lapse");
    }
    let prefix = Artifacts::prefix(id, attempt);
    // A finish whose answer was lost may have been committed: only what nobody owns is removed, the rest is swept
    // later.
    if let Ok(false) = records.owns_prefix(&prefix, id, attempt).await
        && let Err(error) = workshop.artifacts.remove(&prefix).await
    {
        tracing::warn!(job = %id, attempt, %error, "the attempt's artifacts could not be removed");
    }
}
