//! Who waits for what to change, and one look at the store for all of them.
//!
//! A thousand listeners that each ask the store seven times a second are seven thousand questions; here they are seven,
//! whatever process changes a job or publishes a map, and a job that has changed is read once. Nor are they all told at the
//! same moment: a thousand answers at once would keep everybody else waiting for as long as they take.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};

use super::Workshop;
use crate::jobs::Job;
use crate::store::StoreError;

/// How often what is followed is looked at.
const LOOK: Duration = Duration::from_millis(150);
/// Between two followers of one thing that are told: longer than an answer takes, so that a question comes between. All
/// are told within `SPREAD`, which is less than a heartbeat.
const APART: Duration = Duration::from_micros(150);
const SPREAD: Duration = Duration::from_millis(300);

/// A job of a tenant.
pub(super) type JobKey = (String, String);

/// What is followed, with the latest that was seen.
pub(super) struct Followed<K, V> {
    latest: Mutex<HashMap<K, watch::Sender<Seen<V>>>>,
    /// Who followed first, second and so on, to tell them one after the other.
    came: AtomicU32,
    /// Told when somebody begins to follow.
    begun: Notify,
}

/// A revision, and what was read with it.
#[derive(Debug, Clone)]
struct Seen<V> {
    revision: i64,
    value: Option<V>,
}

impl<K, V> Default for Followed<K, V> {
    fn default() -> Self {
        Self { latest: Mutex::default(), came: AtomicU32::new(0), begun: Notify::new() }
    }
}

impl Workshop {
    /// Resolves when a job's revision exceeds one: the job. `None` where the watch is over.
    pub async fn changed_since(&self, tenant: &str, id: &str, revision: i64) -> Option<Arc<Job>> {
        self.followed.changed_since((tenant.to_owned(), id.to_owned()), revision).await
    }

    /// Resolves when a place's serial exceeds one: `true`. `false` where the place is gone, or the watch is over.
    pub async fn republished_since(&self, tenant: &str, name: &str, serial: i64) -> bool {
        self.waited_for.changed_since((tenant.to_owned(), name.to_owned()), serial).await.is_some()
    }

    /// Looks after followed jobs until the service drains.
    pub(super) async fn watch_jobs(&self) {
        loop {
            let Some(keys) = self.followed.some(self).await else { return };
            match self.changed(&keys).await {
                Ok(changed) => self.followed.tell(&keys, changed),
                Err(error) => tracing::warn!(%error, "followed jobs could not be looked at"),
            }
            tokio::select! {
                () = tokio::time::sleep(LOOK) => {}
                () = self.drained() => return,
            }
        }
    }

    /// The followed jobs that are there still, those that have changed read.
    async fn changed(&self, keys: &[JobKey]) -> Result<Vec<(JobKey, Seen<Arc<Job>>)>, StoreError> {
        let ids: Vec<String> = keys.iter().map(|(_, id)| id.clone()).collect();
        let revisions: HashMap<String, i64> = self.records.revisions(&ids).await?.into_iter().collect();
        let mut there = Vec::new();
        for key in keys {
            let Some(revision) = revisions.get(&key.1).copied() else { continue };
            let mut seen = Seen { revision, value: None };
            if self.followed.is_news(key, revision) {
                let Some(job) = self.records.job(&key.0, &key.1).await? else { continue };
                seen = Seen { revision: job.revision, value: Some(Arc::new(job)) };
            }
            there.push((key.clone(), seen));
        }
        Ok(there)
    }

    /// Looks after places that somebody waits for, likewise; at once where it is told of a publication.
    pub(super) async fn watch_places(&self) {
        loop {
            let Some(places) = self.waited_for.some(self).await else { return };
            let published = self.published.notified();
            match self.records.place_serials(&places).await {
                Ok(serials) => {
                    let seen = |(place, revision)| (place, Seen { revision, value: Some(()) });
                    self.waited_for.tell(&places, serials.into_iter().map(seen).collect());
                }
                Err(error) => tracing::warn!(%error, "places could not be looked at"),
            }
            tokio::select! {
                () = tokio::time::sleep(LOOK) => {}
                () = published => {}
                () = self.drained() => return,
            }
        }
    }
}

impl<K: Clone + Eq + Hash, V: Clone> Followed<K, V> {
    /// What was read with a revision above this one; `None` where the watch is over.
    async fn changed_since(&self, key: K, revision: i64) -> Option<V> {
        let (mut latest, place) = {
            let mut all = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
            let first = || watch::Sender::new(Seen { revision, value: None });
            (all.entry(key.clone()).or_insert_with(first).subscribe(), self.came.fetch_add(1, Ordering::Relaxed))
        };
        self.begun.notify_one();
        latest.wait_for(|latest| latest.revision > revision && latest.value.is_some()).await.ok()?;
        tokio::time::sleep(turn(place, self.followers(&key))).await;
        // What has come meanwhile is newer.
        let newest = latest.borrow();
        newest.value.clone()
    }

    fn followers(&self, key: &K) -> u32 {
        let all = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        all.get(key).map_or(1, |latest| u32::try_from(latest.receiver_count()).unwrap_or(u32::MAX).max(1))
    }

    /// Whether this revision was not read yet. The first is, too: who follows second may know an older one.
    fn is_news(&self, key: &K, revision: i64) -> bool {
        let all = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let is_news = |seen: &Seen<V>| seen.revision != revision || seen.value.is_none();
        all.get(key).is_some_and(|latest| is_news(&latest.borrow()))
    }

    /// What somebody follows, once there is something; `None` where the service drains.
    async fn some(&self, workshop: &Workshop) -> Option<Vec<K>> {
        loop {
            let keys = self.still();
            if !keys.is_empty() {
                return Some(keys);
            }
            tokio::select! {
                () = self.begun.notified() => {}
                () = workshop.drained() => return None,
            }
        }
    }

    fn still(&self) -> Vec<K> {
        let mut all = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|_, latest| latest.receiver_count() > 0);
        all.keys().cloned().collect()
    }

    /// Passes on what has changed; whoever follows what is gone is let go.
    fn tell(&self, keys: &[K], there: Vec<(K, Seen<V>)>) {
        let mut all = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let mut there: HashMap<K, Seen<V>> = there.into_iter().collect();
        for key in keys {
            match (there.remove(key), all.get(key)) {
                (Some(new), Some(latest)) => {
                    latest.send_if_modified(|seen| {
                        let is_news = seen.revision != new.revision || (seen.value.is_none() && new.value.is_some());
                        if is_news {
                            *seen = new;
                        }
                        is_news
                    });
                }
                _ => drop(all.remove(key)),
            }
        }
    }
}

/// How long a follower waits for its turn to be told.
fn turn(place: u32, followers: u32) -> Duration {
    APART.min(SPREAD / followers) * (place % followers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_follower_is_told_at_once_and_a_crowd_one_after_the_other() {
        assert_eq!(turn(17, 1), Duration::ZERO);
        assert_eq!((turn(0, 1000), turn(999, 1000)), (Duration::ZERO, 999 * APART));
        assert!((0..100_000).all(|place| turn(place, 100_000) < SPREAD));
    }
}
