//! Where an attempt offers the branches of its passes to other workers.
//!
//! What goes wrong between the attempt and the others is told in the log and costs time alone: a part whose answer is damaged,
//! or whose row is gone, is done here; one that could not be sent is given back by whoever waits for it in vain. While the
//! store is away nothing is known of the parts: the attempt waits for it, as it does elsewhere, until its lease is lost.

use std::collections::{BTreeMap, BTreeSet};
use std::future::Future;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::runtime::Handle;

use super::letters;
use crate::sparse::{Abroad, Answer, Offer, Parcel};
use crate::store::{Artifacts, Part, Pass, Standing};
use crate::worker::Workshop;

/// How often the store is asked how parts stand.
const LOOK: Duration = Duration::from_millis(50);

/// One attempt's.
pub struct Desk {
    pub workshop: Arc<Workshop>,
    pub runtime: Handle,
    pub job_id: String,
    pub attempt: i64,
    /// The attempt's.
    pub stop: Arc<AtomicBool>,
}

impl Abroad for Desk {
    fn offer(&self, branches: usize) -> Option<Box<dyn Offer>> {
        let prefix = Artifacts::of_attempt(&self.job_id, self.attempt);
        let pass = Pass { job_id: self.job_id.clone(), attempt: self.attempt, prefix: prefix.clone() };
        let records = self.workshop.records.clone();
        match done(&self.runtime, async move { records.offer_parts(&pass, branches).await }) {
            Some(Ok(true)) => {}
            // The lease is lost: the attempt ends soon.
            Some(Ok(false)) | None => return None,
            Some(Err(error)) => {
                tracing::warn!(job = %self.job_id, %error, "parts could not be offered to other workers");
                return None;
            }
        }
        let (workshop, runtime, stop) = (self.workshop.clone(), self.runtime.clone(), self.stop.clone());
        Some(Box::new(OnOffer { workshop, runtime, prefix, stop, seen: Mutex::default() }))
    }
}

/// Runs on the runtime's threads what may open connections: those of this one have the lowest priority.
fn done<T: Send + 'static>(runtime: &Handle, work: impl Future<Output = T> + Send + 'static) -> Option<T> {
    runtime.block_on(runtime.spawn(work)).ok()
}

/// The parts of one pass.
struct OnOffer {
    workshop: Arc<Workshop>,
    runtime: Handle,
    prefix: String,
    stop: Arc<AtomicBool>,
    seen: Mutex<Seen>,
}

/// What is known of them.
#[derive(Default)]
struct Seen {
    looked: Option<Instant>,
    /// Whether the store ever answered.
    is_known: bool,
    parts: BTreeMap<usize, (Part, Standing)>,
    /// The claims whose parcels were sent, or could not be.
    sent: BTreeMap<usize, i64>,
    /// Those whose answers were taken.
    answered: BTreeSet<usize>,
    /// Those whose answers were none.
    spoilt: BTreeSet<usize>,
    wrote: bool,
}

impl OnOffer {
    fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How the parts stand, as of lately.
    fn look(&self) -> MutexGuard<'_, Seen> {
        let mut seen = self.seen();
        if seen.looked.is_none_or(|at| at.elapsed() >= LOOK) {
            let (records, prefix) = (self.workshop.records.clone(), self.prefix.clone());
            match done(&self.runtime, async move { records.parts_of(&prefix).await }) {
                Some(Ok(parts)) => {
                    let numbered = |(part, standing): (Part, Standing)| (part.number as usize, (part, standing));
                    seen.parts = parts.into_iter().map(numbered).collect();
                    seen.is_known = true;
                }
                Some(Err(error)) => tracing::warn!(%error, "how parts stand could not be asked"),
                None => {}
            }
            seen.looked = Some(Instant::now());
        }
        seen
    }

    fn post(&self, part: &Part, parcel: &Parcel) -> Result<(), String> {
        let bytes = letters::of_parcel(parcel).map_err(|error| error.to_string())?;
        let (workshop, part) = (self.workshop.clone(), part.clone());
        let sent = async move {
            let [name, _] = part.files();
            workshop.artifacts.put_for_now(&part.prefix, &name, bytes).await.map_err(|error| error.to_string())?;
            // Whether it is held still is no matter: another claim asks for another parcel.
            workshop.records.send_part(&part).await.map(drop).map_err(|error| error.to_string())
        };
        done(&self.runtime, sent).unwrap_or_else(|| Err("the runtime is gone".into()))
    }

    fn fetch(&self, part: &Part) -> Result<Answer, String> {
        let (workshop, part) = (self.workshop.clone(), part.clone());
        let got = async move {
            let [_, name] = part.files();
            workshop.artifacts.get(&part.prefix, &name, None).await.map_err(|error| error.to_string())
        };
        let bytes = done(&self.runtime, got).unwrap_or_else(|| Err("the runtime is gone".into()))?;
        letters::answer(&bytes).map_err(|error| error.to_string())
    }
}

impl Offer for OnOffer {
    fn keep(&self, branch: usize) -> bool {
        {
            let seen = self.look();
            match seen.parts.get(&branch) {
                _ if seen.spoilt.contains(&branch) => return true,
                Some((_, Standing::Free)) => {}
                Some(_) => return false,
                // Nobody can have it any more.
                None => return seen.is_known,
            }
        }
        let (records, prefix) = (self.workshop.records.clone(), self.prefix.clone());
        match done(&self.runtime, async move { records.keep_part(&prefix, branch as i64).await }) {
            Some(Ok(kept)) => kept,
            Some(Err(error)) => {
                tracing::warn!(%error, "a part could not be kept");
                false
            }
            None => false,
        }
    }

    fn wanted(&self) -> Vec<usize> {
        let seen = self.look();
        let unsent = |number: &usize, part: &Part| seen.sent.get(number) != Some(&part.claim);
        let wanted =
            seen.parts.iter().filter(|(number, (part, standing))| *standing == Standing::Taken && unsent(number, part));
        wanted.map(|(number, _)| *number).collect()
    }

    fn send(&self, branch: usize, parcel: &Parcel) {
        let Some((part, _)) = self.seen().parts.get(&branch).cloned() else { return };
        let sent = self.post(&part, parcel);
        let mut seen = self.seen();
        seen.wrote = true;
        // Whoever waits for one that could not be sent gives the part back.
        seen.sent.insert(branch, part.claim);
        if let Err(error) = sent {
            tracing::warn!(part = branch, %error, "a part could not be sent");
        }
    }

    fn answer(&self) -> Option<(usize, Answer)> {
        loop {
            let due = {
                let seen = self.look();
                let due = |(number, (_, standing)): &(&usize, &(Part, Standing))| {
                    *standing == Standing::Delivered && !seen.answered.contains(number)
                };
                seen.parts.iter().find(due).map(|(number, (part, _))| (*number, part.clone()))
            };
            let (number, part) = due?;
            self.seen().answered.insert(number);
            match self.fetch(&part) {
                Ok(answer) => return Some((number, answer)),
                Err(error) => {
                    tracing::warn!(part = number, %error, "a part's answer cannot be read; it is done here");
                    self.seen().spoilt.insert(number);
                }
            }
        }
    }

    fn goes_on(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }
}

impl Drop for OnOffer {
    /// What cannot be taken away now is nobody's once the attempt has ended.
    fn drop(&mut self) {
        let (workshop, prefix, wrote) = (self.workshop.clone(), self.prefix.clone(), self.seen().wrote);
        let withdrawn = async move {
            if let Err(error) = workshop.records.withdraw_parts(&prefix).await {
                tracing::warn!(%error, "parts could not be withdrawn");
            }
            if wrote && let Err(error) = workshop.artifacts.remove(&prefix).await {
                tracing::warn!(%error, "what parts left could not be removed; it will be swept");
            }
        };
        self.runtime.spawn(withdrawn);
    }
}
