//! Who waits for what to change, and one look at the store for all of them.
//!
//! A thousand listeners that each ask the store seven times a second are seven thousand questions; here they are seven,
//! whatever process changes a job or publishes a map.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};

use super::Workshop;

/// How often what is followed is looked at.
const LOOK: Duration = Duration::from_millis(150);

/// What is followed, with the latest revision seen.
pub(super) struct Followed<K> {
    latest: Mutex<HashMap<K, watch::Sender<i64>>>,
    /// Told when somebody begins to follow.
    begun: Notify,
}

impl<K> Default for Followed<K> {
    fn default() -> Self {
        Self { latest: Mutex::default(), begun: Notify::new() }
    }
}

impl Workshop {
    /// Resolves when a job's revision exceeds one: `true`. `false` where the watch is over.
    pub async fn changed_since(&self, id: &str, revision: i64) -> bool {
        self.followed.changed_since(id.to_owned(), revision).await
    }

    /// Resolves when a place's serial exceeds one: `true`. `false` where the place is gone, or the watch is over.
    pub async fn republished_since(&self, tenant: &str, name: &str, serial: i64) -> bool {
        self.waited_for.changed_since((tenant.to_owned(), name.to_owned()), serial).await
    }

    /// Looks after followed jobs until the service drains.
    pub(super) async fn watch_jobs(&self) {
        loop {
            let Some(ids) = self.followed.some(self).await else { return };
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

    /// Looks after places that somebody waits for, likewise; at once where this process publishes.
    pub(super) async fn watch_places(&self) {
        loop {
            let Some(places) = self.waited_for.some(self).await else { return };
            let published = self.published.notified();
            match self.records.place_serials(&places).await {
                Ok(serials) => self.waited_for.tell(&places, serials),
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

impl<K: Clone + Eq + Hash> Followed<K> {
    async fn changed_since(&self, key: K, revision: i64) -> bool {
        let mut latest = {
            let mut all = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
            all.entry(key).or_insert_with(|| watch::Sender::new(revision)).subscribe()
        };
        self.begun.notify_one();
        latest.wait_for(|latest| *latest > revision).await.is_ok()
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

    /// Passes on revisions; whoever follows what is gone is let go.
    fn tell(&self, keys: &[K], revisions: Vec<(K, i64)>) {
        let mut all = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let known: HashMap<K, i64> = revisions.into_iter().collect();
        for key in keys {
            match (known.get(key), all.get(key)) {
                (Some(revision), Some(latest)) => {
                    latest.send_if_modified(|seen| std::mem::replace(seen, *revision) != *revision);
                }
                _ => drop(all.remove(key)),
            }
        }
    }
}
