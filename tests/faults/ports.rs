//! Every port of a store, passed on to the real one; the named points through [`Faulty::at`].

use std::time::Duration;

use async_trait::async_trait;
use mapfit::jobs::{Job, MapRecord, ProblemReport, Progress};
use mapfit::store::*;

use crate::faulty::Faulty;

#[async_trait]
impl JobBoard for Faulty {
    async fn submit(&self, job: NewJob) -> Result<Submission, StoreError> {
        self.at("submit", self.inner.submit(job)).await
    }
    async fn job(&self, tenant: &str, id: &str) -> Result<Option<Job>, StoreError> {
        self.inner.job(tenant, id).await
    }
    async fn jobs(&self, listing: &Listing) -> Result<Vec<Job>, StoreError> {
        self.inner.jobs(listing).await
    }
    async fn request(&self, tenant: &str, id: &str) -> Result<Option<Vec<u8>>, StoreError> {
        self.inner.request(tenant, id).await
    }
    async fn cancel(&self, tenant: &str, id: &str) -> Result<Cancellation, StoreError> {
        self.at("cancel", self.inner.cancel(tenant, id)).await
    }
    async fn relabel_job(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<Job>, StoreError> {
        self.inner.relabel_job(tenant, id, change).await
    }
    async fn remove_job(&self, tenant: &str, id: &str) -> Result<Removal, StoreError> {
        self.inner.remove_job(tenant, id).await
    }
    async fn revisions(&self, ids: &[String]) -> Result<Vec<(String, i64)>, StoreError> {
        self.inner.revisions(ids).await
    }
}

#[async_trait]
impl PartBoard for Faulty {
    async fn offer_parts(&self, pass: &Pass, count: usize) -> Result<bool, StoreError> {
        self.inner.offer_parts(pass, count).await
    }
    async fn parts_of(&self, prefix: &str) -> Result<Vec<(Part, Standing)>, StoreError> {
        self.inner.parts_of(prefix).await
    }
    async fn keep_part(&self, prefix: &str, number: i64) -> Result<bool, StoreError> {
        self.inner.keep_part(prefix, number).await
    }
    async fn send_part(&self, part: &Part) -> Result<bool, StoreError> {
        self.inner.send_part(part).await
    }
    async fn withdraw_parts(&self, prefix: &str) -> Result<(), StoreError> {
        self.inner.withdraw_parts(prefix).await
    }
    async fn take_part(&self, worker: &str, lease: Duration) -> Result<Option<Part>, StoreError> {
        self.inner.take_part(worker, lease).await
    }
    async fn hold_part(&self, part: &Part, lease: Duration) -> Result<Hold, StoreError> {
        self.inner.hold_part(part, lease).await
    }
    async fn deliver_part(&self, part: &Part) -> Result<bool, StoreError> {
        self.inner.deliver_part(part).await
    }
}

#[async_trait]
impl Leases for Faulty {
    async fn claim(&self, terms: &Terms) -> Result<Option<Claim>, StoreError> {
        self.at("claim", self.inner.claim(terms)).await
    }
    async fn heartbeat(
        &self,
        id: &str,
        attempt: i64,
        progress: &Progress,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        self.at("heartbeat", self.inner.heartbeat(id, attempt, progress, lease)).await
    }
    async fn succeed(&self, attempt: i64, map: &MapRecord, done: &Progress) -> Result<bool, StoreError> {
        self.at("succeed", self.inner.succeed(attempt, map, done)).await
    }
    async fn fail(&self, id: &str, attempt: i64, problem: &ProblemReport) -> Result<bool, StoreError> {
        self.at("fail", self.inner.fail(id, attempt, problem)).await
    }
    async fn retry(
        &self,
        id: &str,
        attempt: i64,
        delay: Duration,
        message: &str,
        progress: &Progress,
    ) -> Result<bool, StoreError> {
        self.at("retry", self.inner.retry(id, attempt, delay, message, progress)).await
    }
    async fn release(&self, id: &str, attempt: i64, progress: &Progress) -> Result<bool, StoreError> {
        self.at("release", self.inner.release(id, attempt, progress)).await
    }
}

#[async_trait]
impl MapShelf for Faulty {
    async fn map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError> {
        self.inner.map(tenant, id).await
    }
    async fn maps(&self, listing: &Listing) -> Result<Vec<MapRecord>, StoreError> {
        self.inner.maps(listing).await
    }
    async fn relabel_map(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<MapRecord>, StoreError> {
        self.inner.relabel_map(tenant, id, change).await
    }
    async fn remove_map(&self, tenant: &str, id: &str) -> Result<MapRemoval, StoreError> {
        self.inner.remove_map(tenant, id).await
    }
}

#[async_trait]
impl Places for Faulty {
    async fn publish(
        &self,
        tenant: &str,
        name: &str,
        map_id: &str,
        note: Option<&str>,
        guard: &Guard,
    ) -> Result<Publication, StoreError> {
        self.inner.publish(tenant, name, map_id, note, guard).await
    }
    async fn place(&self, tenant: &str, name: &str) -> Result<Option<Place>, StoreError> {
        self.inner.place(tenant, name).await
    }
    async fn place_version(&self, tenant: &str, name: &str, version: i64) -> Result<Option<Place>, StoreError> {
        self.inner.place_version(tenant, name, version).await
    }
    async fn places(&self, tenant: &str, before: Option<i64>, limit: i64) -> Result<Vec<Place>, StoreError> {
        self.inner.places(tenant, before, limit).await
    }
    async fn place_versions(
        &self,
        tenant: &str,
        name: &str,
        before: Option<i64>,
        limit: i64,
    ) -> Result<Vec<Place>, StoreError> {
        self.inner.place_versions(tenant, name, before, limit).await
    }
    async fn remove_place(&self, tenant: &str, name: &str, guard: &Guard) -> Result<Option<bool>, StoreError> {
        self.inner.remove_place(tenant, name, guard).await
    }
    async fn place_serials(&self, places: &[(String, String)]) -> Result<Vec<((String, String), i64)>, StoreError> {
        self.inner.place_serials(places).await
    }
}

#[async_trait]
impl Keys for Faulty {
    async fn add_key(&self, key: &NewKey) -> Result<ApiKey, StoreError> {
        self.inner.add_key(key).await
    }
    async fn key(&self, id: &str) -> Result<Option<ApiKey>, StoreError> {
        self.inner.key(id).await
    }
    async fn keys(&self) -> Result<Vec<ApiKey>, StoreError> {
        self.inner.keys().await
    }
    async fn revoke_key(&self, id: &str) -> Result<bool, StoreError> {
        self.inner.revoke_key(id).await
    }
    async fn has_keys(&self) -> Result<bool, StoreError> {
        self.inner.has_keys().await
    }
}

#[async_trait]
impl Webhooks for Faulty {
    async fn add_webhook(&self, hook: &NewWebhook) -> Result<Webhook, StoreError> {
        self.inner.add_webhook(hook).await
    }
    async fn webhook(&self, tenant: &str, id: &str) -> Result<Option<Webhook>, StoreError> {
        self.inner.webhook(tenant, id).await
    }
    async fn webhooks(&self, tenant: &str, before: Option<&str>, limit: i64) -> Result<Vec<Webhook>, StoreError> {
        self.inner.webhooks(tenant, before, limit).await
    }
    async fn remove_webhook(&self, tenant: &str, id: &str) -> Result<bool, StoreError> {
        self.inner.remove_webhook(tenant, id).await
    }
    async fn deliveries(&self, webhook_id: &str, before: Option<i64>, limit: i64) -> Result<Vec<Delivery>, StoreError> {
        self.inner.deliveries(webhook_id, before, limit).await
    }
    async fn take_deliveries(
        &self,
        limit: i64,
        hold: Duration,
        except: &[String],
    ) -> Result<Vec<DueDelivery>, StoreError> {
        self.inner.take_deliveries(limit, hold, except).await
    }
    async fn settle_delivery(&self, id: &str, attempt: i64, outcome: &Delivered) -> Result<bool, StoreError> {
        self.inner.settle_delivery(id, attempt, outcome).await
    }
    async fn forget_deliveries(&self, age: Duration, limit: i64) -> Result<u64, StoreError> {
        self.inner.forget_deliveries(age, limit).await
    }
}

#[async_trait]
impl Housekeeping for Faulty {
    async fn reap(&self, verdict: Judge) -> Result<u64, StoreError> {
        self.at("reap", self.inner.reap(verdict)).await
    }
    async fn owned(&self, written: &[Written]) -> Result<Vec<bool>, StoreError> {
        self.inner.owned(written).await
    }
    async fn probe(&self) -> Result<(), StoreError> {
        self.inner.probe().await
    }
    async fn maps_older_than(
        &self,
        age: Duration,
        after: (i64, &str),
        limit: i64,
    ) -> Result<Vec<(MapRecord, Duration)>, StoreError> {
        self.inner.maps_older_than(age, after, limit).await
    }
    async fn holdings(&self, tenant: &str) -> Result<Holdings, StoreError> {
        self.inner.holdings(tenant).await
    }
    async fn totals(&self) -> Result<Totals, StoreError> {
        self.inner.totals().await
    }
}

#[async_trait]
impl Backup for Faulty {
    async fn save(&self, take: &mut Take<'_>) -> Result<(), StoreError> {
        self.inner.save(take).await
    }
    async fn restore(&self, saved: &[Saved]) -> Result<usize, StoreError> {
        self.inner.restore(saved).await
    }
}
