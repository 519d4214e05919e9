//! One attempt at one job: from the claimed request to a finished map, or to the reason why not.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use bytes::Bytes;
use sha2::{Digest, Sha256};
use thiserror::Error;
use tokio::runtime::Handle;
use uuid::Uuid;

use super::Workshop;
use super::background::in_background_while;
use super::clock::Clock;
use super::hands::Borrower;
use super::parts::Desk;
use super::solver::{Follower, WHOLE};
use super::trail::Trail;
use crate::fit::FitError;
use crate::jobs::lifecycle::{MAX_ATTEMPTS, backoff, runs_again};
use crate::jobs::{JobRequest, Joined, Limits, Lineage, MapRecord, ProblemReport, Progress, RequestError, Stored};
use crate::living::{JoinError, aligned};
use crate::map::{ArchiveError, FittedMap, MapError, Stage, SurveyError};
use crate::sparse::Team;
use crate::store::{Artifacts, ArtifactsError, Claim, MAP_FILE, StoreError, Written};
use crate::uncertainty::UncertaintyError;

/// How often the lease is renewed and progress carried to the store.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// How long a finished fit is kept for an artifact store that is away, and how often it is tried: longer than a restart
/// takes. Fitting anew would cost more, and one of few attempts.
const STORED_WITHIN: Duration = Duration::from_secs(120);
const STORED_AGAIN: Duration = Duration::from_secs(1);
/// How long the removal of what is of no use may take: the sweep does it otherwise.
const REMOVED_WITHIN: Duration = Duration::from_secs(3);
/// How often somebody who waits looks whether it was told to stop.
const LOOK: Duration = Duration::from_millis(50);

#[derive(Debug, Error)]
enum AttemptError {
    #[error("the attempt was told to stop")]
    Stopped,
    #[error("the fit was not done after {} s, as long as one may take (--job-seconds)", .0.as_secs())]
    TooLong(Duration),
    #[error("the stored request cannot be read: {0}")]
    Request(#[from] RequestError),
    #[error("the stored request cannot be unpacked: {0}")]
    Unpack(std::io::Error),
    #[error(transparent)]
    Survey(SurveyError),
    #[error(transparent)]
    Join(JoinError),
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    #[error(transparent)]
    Artifacts(#[from] ArtifactsError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("there is no thread to fit on: {0}")]
    Thread(std::io::Error),
    #[error("the solver panicked: {0}")]
    Panic(String),
}

impl From<SurveyError> for AttemptError {
    fn from(error: SurveyError) -> Self {
        if error.is_cancelled() { Self::Stopped } else { Self::Survey(error) }
    }
}

impl From<JoinError> for AttemptError {
    fn from(error: JoinError) -> Self {
        if error == JoinError::Cancelled { Self::Stopped } else { Self::Join(error) }
    }
}

impl AttemptError {
    /// Whether another attempt may fare better: only where the infrastructure failed.
    fn may_pass(&self) -> bool {
        matches!(self, Self::Artifacts(_) | Self::Store(_) | Self::Thread(_) | Self::Panic(_))
    }

    fn problem(&self) -> ProblemReport {
        let (slug, title) = match self {
            Self::Survey(SurveyError::Fit(FitError::NoEvidence)) => {
                ("no-evidence", "The scans say nothing about the map's area")
            }
            Self::Survey(SurveyError::Fit(FitError::Undetermined))
            | Self::Survey(SurveyError::Map(MapError::Uncertainty(UncertaintyError::IllConditioned { .. }))) => {
                ("ill-determined", "The scans do not determine the map")
            }
            Self::Join(JoinError::Undetermined { .. } | JoinError::Apart { .. }) => {
                ("frames-undetermined", "The maps do not tell how they lie to each other")
            }
            Self::Join(JoinError::Mismatch { .. } | JoinError::Far { .. }) => {
                ("maps-do-not-match", "The maps do not match where they were guessed to lie")
            }
            Self::Survey(_) | Self::Join(_) => ("fit-failed", "The map could not be fitted"),
            Self::TooLong(_) => ("job-too-long", "The job took longer than one may"),
            Self::Panic(_) => ("solver-panicked", "The solver failed in a way it should not"),
            _ => ("internal-error", "The job could not be finished"),
        };
        ProblemReport {
            r#type: format!("/problems/{slug}"),
            title: title.into(),
            status: if matches!(self, Self::Survey(_) | Self::Join(_) | Self::TooLong(_)) { 422 } else { 500 },
            detail: self.to_string(),
        }
    }
}

/// Runs a claimed job to its end on this thread.
pub(super) fn run(workshop: &Arc<Workshop>, runtime: &Handle, claim: Claim, asked: SystemTime) {
    let (id, attempt) = (claim.job.id.clone(), claim.job.attempt);
    let trail = Trail::of(&workshop.traces, &claim.job, asked);
    let stop = workshop.enter(&id);
    let progress = Arc::new(Mutex::new(Progress { stage: "preparing".into(), ..claim.job.progress.clone() }));
    let clock = Arc::new(Clock::new(workshop.rules.attempt_within));
    let watched = (progress.clone(), clock.clone());
    let heart = runtime.spawn(keep_lease(workshop.clone(), id.clone(), attempt, watched, stop.clone()));
    let prefix = Artifacts::of_attempt(&id, attempt);
    let own = Own { prefix, claim, progress, clock: clock.clone(), stop, trail };
    // A panic in the numerics costs this attempt, not the solver thread.
    let own = Arc::new(own);
    let work = std::panic::AssertUnwindSafe(|| work(workshop, runtime, &own));
    let mut outcome = std::panic::catch_unwind(work).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        Err(AttemptError::Panic(text.unwrap_or_default()))
    });
    heart.abort();
    workshop.leave(&id);
    if matches!(outcome, Err(AttemptError::Stopped)) && clock.is_up() {
        outcome = Err(AttemptError::TooLong(workshop.rules.attempt_within));
    }
    match outcome {
        Ok(()) => {
            workshop.metrics.attempt_ended("successful");
            own.trail.ended("successful");
            workshop.hooks.notify_one();
        }
        Err(error) => {
            own.trail.fail(&error.to_string());
            own.trail.enter("finish");
            own.trail.ended(runtime.block_on(settle(workshop, &own.claim, &own.prefix, &error)));
        }
    }
}

/// What belongs to one attempt.
struct Own {
    claim: Claim,
    prefix: String,
    progress: Arc<Mutex<Progress>>,
    clock: Arc<Clock>,
    stop: Arc<AtomicBool>,
    trail: Trail,
}

impl Own {
    fn goes_on(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Tells the trail of the stages that are a fit's own to know.
    fn stage(&self, stage: Stage) {
        self.trail.enter(match stage {
            Stage::Fitting => "fit",
            Stage::Covariance => "covariance",
        });
    }
}

fn work(workshop: &Arc<Workshop>, runtime: &Handle, own: &Arc<Own>) -> Result<(), AttemptError> {
    let (workshop_too, runtime_too, own_too) = (workshop.clone(), runtime.clone(), own.clone());
    let formed = in_background_while(waits(own.stop.clone(), workshop.rules.stops_within), move || {
        form(&workshop_too, &runtime_too, &own_too)
    });
    let Some(formed) = formed.map_err(AttemptError::Thread)? else {
        tracing::error!(job = %own.claim.job.id, "a fit does not stop; its thread and its memory are lost to the service");
        return Err(AttemptError::Stopped);
    };
    let (record, bytes) = formed?;
    let fitted = Instant::now();
    runtime.block_on(keep(workshop, &own.prefix, bytes, &own.stop))?;
    own.trail.enter("finish");
    let job = &own.claim.job;
    let parts = own.progress.lock().unwrap_or_else(PoisonError::into_inner).parts;
    let done = Progress { parts, ..job.progress.clone() }.done(&record.fit);
    match runtime.block_on(workshop.records.succeed(job.attempt, &record, &done))? {
        true => {
            workshop.metrics.fitted(record.distance.name(), &record.fit, fitted.elapsed());
            Ok(())
        }
        false => Err(AttemptError::Stopped),
    }
}

/// Whether to wait on for work that was told to stop, or was not.
fn waits(stop: Arc<AtomicBool>, within: Duration) -> impl Fn() -> bool {
    let told = OnceLock::new();
    move || !stop.load(Ordering::Relaxed) || told.get_or_init(Instant::now).elapsed() < within
}

/// The map's record and its file: all that takes a core.
fn form(workshop: &Arc<Workshop>, runtime: &Handle, own: &Own) -> Result<(MapRecord, Vec<u8>), AttemptError> {
    let Own { claim, prefix, progress, clock, stop, trail } = own;
    trail.enter("load");
    let (request, lineage) = {
        let stored = zstd::decode_all(&claim.request[..]).map_err(AttemptError::Unpack)?;
        let stored = Stored::read(&stored)?;
        (stored.request(&workshop.limits)?, stored.lineage)
    };
    set_stage(progress, "waiting for memory", 0.0);
    let goes_on = || own.goes_on();
    let (_, cost) = request.cost(&goes_on).ok_or(AttemptError::Stopped)?;
    trail.enter("wait for memory");
    let _held = clock.without(|| workshop.memory.reserve(cost.bytes as u64, &goes_on)).ok_or(AttemptError::Stopped)?;
    set_stage(progress, "fitting", 0.0);
    trail.enter("fit");
    // As it was accepted: a worker's own limit may be another.
    let _divided = claim.job.progress.parts.map(|_| workshop.hands.divided());
    let team = team_of(workshop, runtime, own);
    let follower = Follower { progress, stop, stage: &|stage| own.stage(stage), team };
    let fit = |request: &JobRequest| workshop.solver.map_of(request, &follower);
    let map = match &request.joined {
        Some(joined) => fit_joined(&request, joined, own, &workshop.limits, fit)?,
        None => fit(&request)?,
    };
    set_stage(progress, "storing", WHOLE.1);
    trail.enter("store");
    let bytes = map.to_npz()?;
    let record = record_of(claim, &map, (prefix, &bytes), lineage);
    Ok((record, bytes))
}

/// Who shares the work: this process's solvers that wait, and, where the job is in parts, any process's.
fn team_of(workshop: &Arc<Workshop>, runtime: &Handle, own: &Own) -> Team {
    let job = &own.claim.job;
    let team = Team::with(Arc::new(Borrower { hands: workshop.hands.clone(), progress: own.progress.clone() }));
    if job.progress.parts.is_none() {
        return team;
    }
    let (workshop, runtime, job_id) = (workshop.clone(), runtime.clone(), job.id.clone());
    team.and_abroad(Arc::new(Desk { workshop, runtime, job_id, attempt: job.attempt, stop: own.stop.clone() }))
}

fn record_of(claim: &Claim, map: &FittedMap, (prefix, bytes): (&str, &[u8]), lineage: Lineage) -> MapRecord {
    MapRecord {
        id: Uuid::now_v7().to_string(),
        job_id: claim.job.id.clone(),
        tenant: claim.job.tenant.clone(),
        name: claim.job.name.clone(),
        labels: claim.job.labels.clone(),
        created: 0,
        distance: map.field.distance(),
        lattice: map.lattice().clone(),
        fit: map.report.clone(),
        prefix: prefix.to_owned(),
        bytes: bytes.len() as i64,
        sha256: Some(hex::encode(Sha256::digest(bytes))),
        parent: lineage.parent,
        version: lineage.version,
    }
}

/// Puts the map's file where it stays; tries for a while where the artifact store is away.
async fn keep(workshop: &Workshop, prefix: &str, bytes: Vec<u8>, stop: &AtomicBool) -> Result<(), AttemptError> {
    let (bytes, begun) = (Bytes::from(bytes), Instant::now());
    let kept = async {
        loop {
            match workshop.artifacts.put(prefix, MAP_FILE, bytes.clone()).await {
                Err(error) if begun.elapsed() < STORED_WITHIN => {
                    tracing::warn!(%prefix, %error, "a map could not be stored yet");
                }
                outcome => return Ok(outcome?),
            }
            tokio::time::sleep(STORED_AGAIN).await;
        }
    };
    let stopped = async {
        while !stop.load(Ordering::Relaxed) {
            tokio::time::sleep(LOOK).await;
        }
    };
    tokio::select! {
        biased;
        () = stopped => Err(AttemptError::Stopped),
        outcome = kept => outcome,
    }
}

/// A join: where the frames lie, then one fit of all scans from there.
fn fit_joined(
    request: &JobRequest,
    joined: &Joined,
    own: &Own,
    limits: &Limits,
    fit: impl Fn(&JobRequest) -> Result<FittedMap, SurveyError>,
) -> Result<FittedMap, AttemptError> {
    set_stage(&own.progress, "aligning", 0.0);
    own.trail.enter("align");
    let goes_on = || own.goes_on();
    let map_of = |frame: usize| joined.named.iter().position(|named| named.frame == frame).unwrap_or(frame);
    let places = aligned(&request.scans_in_frames(), &joined.guesses, &goes_on);
    let places = places.map_err(|error| error.of_map(map_of))?;
    set_stage(&own.progress, "fitting", 0.0);
    let placed = request.placed(&places, limits).map_err(JoinError::from)?;
    let mut map = fit(&placed)?;
    joined.tell(&mut map, &places);
    Ok(map)
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
    (progress, clock): (Arc<Mutex<Progress>>, Arc<Clock>),
    stop: Arc<AtomicBool>,
) {
    let lease = workshop.rules.lease;
    let mut beat = tokio::time::interval(HEARTBEAT.min(lease / 3));
    loop {
        beat.tick().await;
        if clock.is_up() {
            stop.store(true, Ordering::Relaxed);
        }
        let now = progress.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match workshop.records.heartbeat(&id, attempt, &now, lease).await {
            Ok(true) => {}
            Ok(false) => {
                tracing::info!(job = %id, attempt, "the lease is lost; the fit stops");
                workshop.metrics.lease_lost();
                stop.store(true, Ordering::Relaxed);
                return;
            }
            // A database that is away may be back before the lease lapses.
            Err(error) => tracing::warn!(job = %id, %error, "a heartbeat failed"),
        }
    }
}

/// Says in the store what became of an attempt that has no map, and how it ended.
async fn settle(workshop: &Workshop, claim: &Claim, prefix: &str, error: &AttemptError) -> &'static str {
    let (records, id, attempt) = (&workshop.records, &claim.job.id[..], claim.job.attempt);
    let queued = claim.job.progress.again();
    let (ended, outcome) = match error {
        // Draining hands the job back; where the lease is lost this writes nothing.
        AttemptError::Stopped => ("stopped", records.release(id, attempt, &queued).await),
        error if error.may_pass() && attempt < MAX_ATTEMPTS => {
            tracing::warn!(job = %id, attempt, %error, "the attempt failed and is retried");
            let message = runs_again(attempt, &error.to_string());
            ("retried", records.retry(id, attempt, backoff(attempt), &message, &queued).await)
        }
        error => {
            tracing::warn!(job = %id, attempt, %error, "the job failed");
            let failed = records.fail(id, attempt, &error.problem()).await;
            workshop.hooks.notify_one();
            ("failed", failed)
        }
    };
    workshop.metrics.attempt_ended(ended);
    if let Err(error) = outcome {
        tracing::error!(job = %id, attempt, %error, "the attempt's end could not be stored; its lease will lapse");
    }
    // A finish whose answer was lost may have been committed: only what nobody owns is removed, the rest is swept
    // later. What was stopped has finished nothing, though the job may run again under the same number by now.
    let written = Written { prefix: prefix.to_owned(), job_id: id.to_owned(), attempt };
    let is_nobodys = match error {
        AttemptError::Stopped => true,
        _ => records.owned(&[written]).await.is_ok_and(|owned| owned == [false]),
    };
    let removal = tokio::time::timeout(REMOVED_WITHIN, workshop.artifacts.remove(prefix));
    if is_nobodys && !matches!(removal.await, Ok(Ok(()))) {
        tracing::warn!(job = %id, attempt, "the attempt's artifacts could not be removed; they will be swept");
    }
    ended
}
