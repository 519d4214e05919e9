//! Whom to tell of what, and what was told. Triggers queue the deliveries: see the migration.

use std::time::Duration;

use async_trait::async_trait;
use uuid::Uuid;

use super::{PostgresStore, now, rows};
use crate::store::{Delivered, Delivery, DueDelivery, NewWebhook, StoreError, Webhook, Webhooks};

const INSERT: &str = concat!(
    "INSERT INTO webhooks (id, tenant, url, events, secret, created) VALUES ($1, $2, $3, $4, $5, ",
    now!(),
    ") RETURNING id, url, events, created"
);
const WEBHOOK: &str = "SELECT id, url, events, created FROM webhooks WHERE id = $1 AND tenant = $2";
const PAGE: &str =
    "SELECT id, url, events, created FROM webhooks WHERE tenant = $1 AND id < $2 ORDER BY id DESC LIMIT $3";
const REMOVE: &str = "DELETE FROM webhooks WHERE id = $1 AND tenant = $2";
const TAKE: &str = concat!(
    "WITH due AS MATERIALIZED (SELECT id FROM deliveries WHERE status = 'pending' AND next_attempt <= ",
    now!(),
    " AND webhook_id <> ALL($3) ORDER BY next_attempt LIMIT $2 FOR UPDATE SKIP LOCKED) \
     UPDATE deliveries AS d SET attempts = d.attempts + 1, last_attempt = ",
    now!(),
    ", next_attempt = ",
    now!(),
    " + $1 FROM due, webhooks AS hook WHERE d.id = due.id AND hook.id = d.webhook_id \
     RETURNING d.id, d.webhook_id, d.payload, d.attempts, hook.url, hook.secret"
);
const SETTLE: &str = concat!(
    "UPDATE deliveries SET status = $1, next_attempt = ",
    now!(),
    " + $2, error = $3 WHERE id = $4 AND attempts = $5 AND status = 'pending'"
);
const FORGET: &str = concat!(
    "DELETE FROM deliveries WHERE serial IN (SELECT serial FROM deliveries WHERE status <> 'pending' \
     AND COALESCE(last_attempt, created) < ",
    now!(),
    " - $1 LIMIT $2 FOR UPDATE SKIP LOCKED)"
);
const DELIVERIES: &str = "SELECT serial, id, webhook_id, event, status, attempts, created, last_attempt, next_attempt, error \
                          FROM deliveries WHERE webhook_id = $1 AND serial < $2 ORDER BY serial DESC LIMIT $3";

#[async_trait]
impl Webhooks for PostgresStore {
    async fn add_webhook(&self, hook: &NewWebhook) -> Result<Webhook, StoreError> {
        let insert = sqlx::query(INSERT).bind(Uuid::now_v7().to_string()).bind(&hook.tenant).bind(&hook.url);
        let insert = insert.bind(serde_json::to_string(&hook.events)?).bind(&hook.secret);
        let rows = insert.fetch_all(&self.pool).await?;
        rows.first().map_or_else(|| Err(sqlx::Error::RowNotFound.into()), rows::webhook)
    }

    async fn webhook(&self, tenant: &str, id: &str) -> Result<Option<Webhook>, StoreError> {
        let query = sqlx::query(WEBHOOK).bind(id).bind(tenant);
        query.fetch_optional(&self.pool).await?.as_ref().map(rows::webhook).transpose()
    }

    async fn webhooks(&self, tenant: &str, before: Option<&str>, limit: i64) -> Result<Vec<Webhook>, StoreError> {
        let query = sqlx::query(PAGE).bind(tenant).bind(before.unwrap_or("~")).bind(limit);
        query.fetch_all(&self.pool).await?.iter().map(rows::webhook).collect()
    }

    async fn remove_webhook(&self, tenant: &str, id: &str) -> Result<bool, StoreError> {
        Ok(sqlx::query(REMOVE).bind(id).bind(tenant).execute(&self.pool).await?.rows_affected() == 1)
    }

    async fn deliveries(&self, webhook_id: &str, before: Option<i64>, limit: i64) -> Result<Vec<Delivery>, StoreError> {
        let query = sqlx::query(DELIVERIES).bind(webhook_id).bind(before.unwrap_or(i64::MAX)).bind(limit);
        query.fetch_all(&self.pool).await?.iter().map(rows::delivery).collect()
    }

    async fn take_deliveries(
        &self,
        limit: i64,
        hold: Duration,
        except: &[String],
    ) -> Result<Vec<DueDelivery>, StoreError> {
        let query = sqlx::query_as(TAKE).bind(hold.as_millis() as i64).bind(limit).bind(except);
        let taken: Vec<(String, String, String, i64, String, String)> = query.fetch_all(&self.pool).await?;
        let due = |(id, webhook_id, payload, attempt, url, secret)| DueDelivery {
            id,
            webhook_id,
            url,
            secret,
            payload,
            attempt,
        };
        Ok(taken.into_iter().map(due).collect())
    }

    async fn forget_deliveries(&self, age: Duration, limit: i64) -> Result<u64, StoreError> {
        let forget = sqlx::query(FORGET).bind(age.as_millis() as i64).bind(limit);
        Ok(forget.execute(&self.pool).await?.rows_affected())
    }

    async fn settle_delivery(&self, id: &str, attempt: i64, outcome: &Delivered) -> Result<bool, StoreError> {
        let (status, delay, error) = match outcome {
            Delivered::Yes => ("delivered", None, None),
            Delivered::NotYet(delay, error) => ("pending", Some(delay.as_millis() as i64), Some(error)),
            Delivered::Never(error) => ("failed", None, Some(error)),
        };
        // PostgreSQL's text has no U+0000, and a stranger's answer may.
        let error = error.map(|error| error.replace('\0', ""));
        let update = sqlx::query(SETTLE).bind(status).bind(delay).bind(error).bind(id).bind(attempt);
        Ok(update.execute(&self.pool).await?.rows_affected() == 1)
    }
}
