//! A part of another's fit, done by a worker that has nothing else to do.

use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use thiserror::Error;
use tokio::runtime::Handle;

use super::letters;
use crate::map::npz::NpzError;
use crate::sparse::{Answer, SparseError};
use crate::store::{ArtifactsError, Hold, Part, StoreError};
use crate::worker::Workshop;
use crate::worker::background::in_background;

/// How often a part is held on to, and its parcel looked for.
const BEAT: Duration = Duration::from_millis(500);
const LOOK: Duration = Duration::from_millis(100);
/// How long a parcel is waited for, and memory for it. Then the part is somebody else's, or its attempt's.
const SENT_WITHIN: Duration = Duration::from_secs(20);
const MEMORY_WITHIN: Duration = Duration::from_secs(2);

#[derive(Debug, Error)]
enum HelpError {
    #[error("it was another's by then, or nobody's")]
    Lost,
    #[error("its parcel did not come in time")]
    Late,
    #[error("there is no memory for it (--memory)")]
    Memory,
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Artifacts(#[from] ArtifactsError),
    #[error("its file cannot be read or written: {0}")]
    File(#[from] NpzError),
    #[error(transparent)]
    Sparse(#[from] SparseError),
    #[error("there is no thread to work on: {0}")]
    Thread(std::io::Error),
    #[error("the work panicked")]
    Panic,
}

/// Does a part that was taken; whether it did. What fails is told in the log: somebody else tries once more, then the attempt
/// whose part it is does it.
pub fn help(workshop: &Arc<Workshop>, runtime: &Handle, part: &Part) -> bool {
    let begun = Instant::now();
    // Draining stops it as it stops attempts.
    let key = format!("{}/{}", part.prefix, part.number);
    tracing::info!(part = %key, "a part begins");
    let stop = workshop.enter(&key);
    let heart = runtime.spawn(keep_hold(workshop.clone(), part.clone(), stop.clone()));
    // A panic in the numerics costs this part, not the solver thread.
    let work = AssertUnwindSafe(|| work(workshop, runtime, part, &stop));
    let outcome = catch_unwind(work).unwrap_or(Err(HelpError::Panic));
    heart.abort();
    workshop.leave(&key);
    match outcome {
        Ok(worked) => {
            workshop.metrics.helped("done");
            let (seconds, of_work) = (begun.elapsed().as_secs_f64(), worked.as_secs_f64());
            tracing::info!(part = %key, seconds, of_work, "a part is done");
            true
        }
        Err(error) => {
            workshop.metrics.helped("left");
            tracing::info!(part = %key, %error, "a part is left to others");
            // Where this fails, too, its lease lapses.
            let _ = runtime.block_on(workshop.records.hold_part(part, Duration::ZERO));
            false
        }
    }
}

/// How long the work itself took.
fn work(workshop: &Workshop, runtime: &Handle, part: &Part, stop: &AtomicBool) -> Result<Duration, HelpError> {
    let [parcel, answer] = part.files();
    runtime.block_on(unless_stopped(stop, sent(workshop, part)))?;
    let get = async { Ok(workshop.artifacts.get(&part.prefix, &parcel, None).await?) };
    let bytes = runtime.block_on(unless_stopped(stop, get))?;
    let parcel = letters::parcel(&bytes)?;
    drop(bytes);
    let (need, asked) = (parcel.working_bytes() as u64, Instant::now());
    let waits = || !stop.load(Ordering::Relaxed) && asked.elapsed() < MEMORY_WITHIN;
    let held = workshop.memory.allows(need).then(|| workshop.memory.reserve(need, &waits)).flatten();
    let _held = held.ok_or(HelpError::Memory)?;
    let begun = Instant::now();
    let worked = match in_background(|| parcel.work(stop)).map_err(HelpError::Thread)? {
        Err(SparseError::Stopped) => return Err(HelpError::Lost),
        // What it means (that a matrix is not positive definite, say) is the attempt's to find out: it does this part itself.
        Err(_) => Answer::default(),
        Ok(worked) => worked,
    };
    let took = begun.elapsed();
    let bytes = letters::of_answer(&worked)?;
    let put = async { Ok(workshop.artifacts.put_for_now(&part.prefix, &answer, bytes).await?) };
    runtime.block_on(unless_stopped(stop, put))?;
    match runtime.block_on(workshop.records.deliver_part(part))? {
        true => Ok(took),
        false => Err(HelpError::Lost),
    }
}

/// Waits until the parcel is there.
async fn sent(workshop: &Workshop, part: &Part) -> Result<(), HelpError> {
    let since = Instant::now();
    loop {
        match workshop.records.hold_part(part, workshop.rules.lease).await? {
            Hold::Sent => return Ok(()),
            Hold::Lost => return Err(HelpError::Lost),
            Hold::Waits if since.elapsed() > SENT_WITHIN => return Err(HelpError::Late),
            Hold::Waits => tokio::time::sleep(LOOK).await,
        }
    }
}

/// What comes of it, unless it is stopped before.
async fn unless_stopped<T>(
    stop: &AtomicBool,
    work: impl Future<Output = Result<T, HelpError>>,
) -> Result<T, HelpError> {
    let stopped = async {
        while !stop.load(Ordering::Relaxed) {
            tokio::time::sleep(LOOK).await;
        }
    };
    tokio::select! {
        biased;
        () = stopped => Err(HelpError::Lost),
        outcome = work => outcome,
    }
}

/// Holds on to a part; stops the work where it is another's, or nobody's any more.
async fn keep_hold(workshop: Arc<Workshop>, part: Part, stop: Arc<AtomicBool>) {
    let lease = workshop.rules.lease;
    let mut beat = tokio::time::interval(BEAT.min(lease / 3));
    loop {
        beat.tick().await;
        match workshop.records.hold_part(&part, lease).await {
            Ok(Hold::Lost) => {
                stop.store(true, Ordering::Relaxed);
                return;
            }
            Ok(_) => {}
            // A database that is away may be back before the lease lapses.
            Err(error) => tracing::warn!(%error, "a part could not be held on to"),
        }
    }
}
