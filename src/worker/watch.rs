//! Who follows which jobs, and one look at the store for all of them.
//!
//! A thousand listeners that each ask the store seven times a second are seven thousand questions; here they are seven,
//! whatever process changes a job.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};

use super::Workshop;

/// How often followed jobs are looked at.
const LOOK: Duration = Duration::from_millis(150);

/// The jobs that are followed, with the latest revision seen.
#[derive(Default)]
pub(super) struct Followed {
    jobs: Mutex<HashMap<String, watch::Sender<i64>>>,
    /// Told when somebody begins to follow.
    begun: Notify,
}

impl Workshop {
    /// Resolves when a job's revision exceeds one: `true`. `false` where the watch is over.
    pub async fn changed_since(&self, id: &str, revision: i64) -> bool {
        let mut latest = {
            let mut jobs = self.followed.jobs.lock().unwrap_or_else(PoisonError::into_inner);
            jobs.entry(id.to_owned()).or_insert_with(|| watch::Sender::new(revision)).subscribe()
        };
        self.followed.begun.notify_one();
        latest.wait_for(|latest| *latest > revision).await.is_ok()
    }

    /// Looks after followed jobs until the service drains.
    pub(super) async fn watch_jobs(&self) {
        loop {
            let ids = self.followed.still();
            if ids.is_empty() {
                tokio::select! {
                    () = self.followed.begun.notified() => continue,
                    () = self.drained() => return,
                }
            }
            match self.records.revisions(&ids).await {
                Ok(revisions) => self.followed.tell(&ids, revisions),
                Err(error) => tracing::warn!(%error, "followed jobs could not be looked at"),
            }
            tokio::select! {
                () = tokio::time::sleep(LOOK) => {}
                () = self.drained() => return,
            }
        }
    }
}

impl Followed {
    /// The jobs that somebody still follows.
    fn still(&self) -> Vec<String> {
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        jobs.retain(|_, latest| latest.receiver_count() > 0);
        jobs.keys().cloned().collect()
    }

    /// Passes on revisions; whoever follows a job that is gone is let go.
    fn tell(&self, ids: &[String], revisions: Vec<(String, i64)>) {
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        let known: HashMap<String, i64> = revisions.into_iter().collect();
        for id in ids {
            match (known.get(id), jobs.get(id)) {
                (Some(revision), Some(latest)) => {
                    latest.send_if_modified(|seen| std::mem::replace(seen, *revision) != *revision);
                }
                _ => drop(jobs.remove(id)),
            }
        }
    }
}
