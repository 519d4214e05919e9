//! What keeps a service in order, beside the solvers: lapsed leases, deadlines, and what is kept no longer.

use std::sync::Arc;
use std::time::Duration;

use super::Workshop;
use crate::jobs::lifecycle;
use crate::store::{MapRemoval, StoreError};

/// How often lapsed leases are looked for.
const REAP: Duration = Duration::from_secs(2);
/// Maps that are looked at together, and deliveries that one statement removes.
const MAPS: i64 = 100;
const DELIVERIES: i64 = 1000;

/// Until the service drains.
pub(super) async fn keep(workshop: Arc<Workshop>) {
    let mut reap = tokio::time::interval(REAP);
    let mut sweep = tokio::time::interval(workshop.rules.sweep_every);
    loop {
        tokio::select! {
            _ = reap.tick() => reap_lapsed(&workshop).await,
            _ = sweep.tick() => tokio::select! {
                () = tidy(&workshop) => {}
                () = workshop.drained() => return,
            },
            () = workshop.drained() => return,
        }
    }
}

async fn reap_lapsed(workshop: &Workshop) {
    match workshop.records.reap(lifecycle::after_lapse).await {
        Ok(0) => {}
        Ok(lapsed) => {
            tracing::warn!(lapsed, "leases had lapsed, or deadlines passed");
            workshop.metrics.reaped(lapsed);
            workshop.arrivals.notify_waiters();
            workshop.hooks.notify_one();
        }
        Err(error) => tracing::warn!(%error, "lapsed leases could not be looked for"),
    }
}

/// Old maps first: their artifacts are nobody's then.
async fn tidy(workshop: &Workshop) {
    match expire_maps(workshop).await {
        Ok(0) => {}
        Ok(expired) => tracing::info!(expired, "maps that are kept no longer were removed"),
        Err(error) => tracing::warn!(%error, "old maps could not be looked for"),
    }
    match expire_deliveries(workshop).await {
        Ok(0) => {}
        Ok(expired) => tracing::info!(expired, "deliveries that ended long ago were forgotten"),
        Err(error) => tracing::warn!(%error, "old deliveries could not be looked for"),
    }
    match workshop.artifacts.sweep(&*workshop.records).await {
        Ok(0) => {}
        Ok(swept) => {
            workshop.metrics.swept("artifacts", swept as u64);
            tracing::info!(swept, "artifacts nobody names were removed");
        }
        Err(error) => tracing::warn!(%error, "artifacts could not be swept"),
    }
}

/// Removes maps that are kept no longer, but none that a place names; how many.
async fn expire_maps(workshop: &Workshop) -> Result<usize, StoreError> {
    let Some(shortest) = workshop.rules.keep_maps.shortest() else { return Ok(0) };
    let (records, mut after, mut expired) = (&workshop.records, (i64::MIN, String::new()), 0);
    loop {
        let page = records.maps_older_than(shortest, (after.0, &after.1), MAPS).await?;
        let Some((last, _)) = page.last() else { return Ok(expired) };
        after = (last.created, last.id.clone());
        for (map, age) in page {
            if !workshop.rules.keep_maps.is_over(&map.labels, age) {
                continue;
            }
            // A place may have got it meanwhile.
            if let MapRemoval::Removed(map) = records.remove_map(&map.tenant, &map.id).await? {
                expired += 1;
                workshop.metrics.swept("maps", 1);
                // What stays behind is swept.
                if let Err(error) = workshop.artifacts.remove(&map.prefix).await {
                    tracing::warn!(map = %map.id, %error, "an old map's arrays could not be removed yet");
                }
            }
        }
    }
}

async fn expire_deliveries(workshop: &Workshop) -> Result<u64, StoreError> {
    let mut expired = 0;
    loop {
        let some = workshop.records.forget_deliveries(workshop.rules.keep_deliveries, DELIVERIES).await?;
        expired += some;
        workshop.metrics.swept("deliveries", some);
        if some < DELIVERIES as u64 {
            return Ok(expired);
        }
    }
}
