//! A part of another's fit, done by a worker that has nothing else to do.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use thiserror::Error;
use tokio::runtime::Handle;

use super::letters;
use crate::map::npz::NpzError;
use crate::sparse::SparseError;
use crate::store::{ArtifactsError, Hold, Part, StoreError};
use crate::worker::Workshop;
use crate::worker::background::in_background;

/// How often a part is held on to, and its parcel looked for.
const BEAT: Duration = Duration::from_millis(500);
const LOOK: Duration = Duration::from_millis(20);
/// How long a parcel, and memory for it, is waited for. Then somebody else may have the part.
const WAITS: Duration = Duration::from_secs(20);

#[derive(Debug, Error)]
enum HelpError {
    #[error("it was another's by then")]
    Lost,
    #[error("{0} did not come in time")]
    Late(&'static str),
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

/// Does a part that was taken. What fails is told in the log: the attempt whose part it is does it then.
pub fn help(workshop: &Arc<Workshop>, runtime: &Handle, part: &Part) {
    let begun = Instant::now();
    // Draining stops it as it stops attempts.
    let key = format!("{}/{}", part.prefix, part.number);
    tracing::info!(part = %key, "a part begins");
    let stop = workshop.enter(&key);
    let heart = runtime.spawn(keep_hold(workshop.clone(), part.clone(), stop.clone()));
    let outcome = work(workshop, runtime, part, &stop);
    heart.abort();
    workshop.leave(&key);
    match outcome {
        Ok(worked) => {
            workshop.metrics.helped("done");
            let (seconds, of_work) = (begun.elapsed().as_secs_f64(), worked.as_secs_f64());
            tracing::info!(part = %key, seconds, of_work, "a part is done");
        }
        Err(error) => {
            workshop.metrics.helped("left");
            tracing::info!(part = %key, %error, "a part is left to others");
            // Where this fails, too, its lease lapses.
            let _ = runtime.block_on(workshop.records.hold_part(part, Duration::ZERO));
        }
    }
}

/// How long the work itself took.
fn work(workshop: &Workshop, runtime: &Handle, part: &Part, stop: &AtomicBool) -> Result<Duration, HelpError> {
    let [parcel, answer] = part.files();
    runtime.block_on(sent(workshop, part))?;
    let bytes = runtime.block_on(workshop.artifacts.get(&part.prefix, &parcel, None))?;
    let parcel = letters::parcel(&bytes)?;
    drop(bytes);
    let waited = Instant::now();
    let waits = || !stop.load(Ordering::Relaxed) && waited.elapsed() < WAITS;
    let held = workshop.memory.reserve(parcel.working_bytes() as u64, &waits);
    let _held = held.ok_or(HelpError::Late("memory"))?;
    // A panic in the numerics costs this part, not the solver thread.
    let begun = Instant::now();
    let work = AssertUnwindSafe(|| in_background(|| parcel.work(stop)));
    let worked = catch_unwind(work).map_err(|_| HelpError::Panic)?.map_err(HelpError::Thread)?;
    let took = begun.elapsed();
    let bytes = letters::of_answer(&worked?)?;
    runtime.block_on(workshop.artifacts.put_for_now(&part.prefix, &answer, bytes))?;
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
            Hold::Waits if since.elapsed() > WAITS => return Err(HelpError::Late("its parcel")),
            Hold::Waits => tokio::time::sleep(LOOK).await,
        }
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
