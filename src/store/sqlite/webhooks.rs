//! Whom to tell of what, and what was told. Triggers queue the deliveries: see the migration.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::AssertSqlSafe;
use uuid::Uuid;

use super::rows::{self, DELIVERY, WEBHOOK};
use super::{SqliteStore, now};
use crate::store::{Delivered, Delivery, DueDelivery, NewWebhook, StoreError, Webhook, Webhooks};

const INSERT: &str = concat!(
    "INSERT INTO webhooks (id, tenant, url, events, secret, created) VALUES (?, ?, ?, ?, ?, ",
    now!(),
    ") RETURNING "
);
const TAKE: &str = concat!(
    "UPDATE deliveries SET attempts = attempts + 1, last_attempt = ",
    now!(),
    ", next_attempt = ",
    now!(),
    " + ? WHERE id IN (SELECT id FROM deliveries WHERE status = 'pending' AND next_attempt <= ",
    now!(),
    " AND webhook_id NOT IN (SELECT value FROM json_each(?)) ORDER BY next_attempt LIMIT ?) \
     RETURNING id, webhook_id, payload, attempts, \
     (SELECT url FROM webhooks WHERE webhooks.id = webhook_id), (SELECT secret FROM webhooks WHERE webhooks.id = webhook_id)"
);
const SETTLE: &str = concat!(
    "UPDATE deliveries SET status = ?, next_attempt = ",
    now!(),
    " + ?, error = ? WHERE id = ? AND attempts = ? AND status = 'pending'"
);
const FORGET: &str = concat!(
    "DELETE FROM deliveries WHERE serial IN (SELECT serial FROM deliveries WHERE status <> 'pending' \
     AND COALESCE(last_attempt, created) < ",
    now!(),
    " - ? LIMIT ?)"
);
const DELIVERIES: &str = " FROM deliveries WHERE webhook_id = ? AND serial < ? ORDER BY serial DESC LIMIT ?";

#[async_trait]
impl Webhooks for SqliteStore {
    async fn add_webhook(&self, hook: &NewWebhook) -> Result<Webhook, StoreError> {
        let mut tx = self.begin().await?;
        let insert = sqlx::query(AssertSqlSafe(format!("{INSERT}{WEBHOOK}")))
            .bind(Uuid::now_v7().to_string())
            .bind(&hook.tenant)
            .bind(&hook.url);
        let insert = insert.bind(serde_json::to_string(&hook.events)?).bind(&hook.secret);
        let rows = insert.fetch_all(&mut *tx).await?;
        tx.commit().await?;
        rows.first().map_or_else(|| Err(sqlx::Error::RowNotFound.into()), rows::webhook)
    }

    async fn webhook(&self, tenant: &str, id: &str) -> Result<Option<Webhook>, StoreError> {
        let query = format!("SELECT {WEBHOOK} FROM webhooks WHERE id = ? AND tenant = ?");
        let query = sqlx::query(AssertSqlSafe(query)).bind(id).bind(tenant);
        query.fetch_optional(&self.readers).await?.as_ref().map(rows::webhook).transpose()
    }

    async fn webhooks(&self, tenant: &str, before: Option<&str>, limit: i64) -> Result<Vec<Webhook>, StoreError> {
        let query = format!("SELECT {WEBHOOK} FROM webhooks WHERE tenant = ? AND id < ? ORDER BY id DESC LIMIT ?");
        let query = sqlx::query(AssertSqlSafe(query)).bind(tenant).bind(before.unwrap_or("~")).bind(limit);
        query.fetch_all(&self.readers).await?.iter().map(rows::webhook).collect()
    }

    async fn remove_webhook(&self, tenant: &str, id: &str) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let query = sqlx::query("DELETE FROM webhooks WHERE id = ? AND tenant = ?").bind(id).bind(tenant);
        let removed = query.execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(removed)
    }

    async fn deliveries(&self, webhook_id: &str, before: Option<i64>, limit: i64) -> Result<Vec<Delivery>, StoreError> {
        let query = sqlx::query(AssertSqlSafe(format!("SELECT {DELIVERY}{DELIVERIES}")))
            .bind(webhook_id)
            .bind(before.unwrap_or(i64::MAX))
            .bind(limit);
        query.fetch_all(&self.readers).await?.iter().map(rows::delivery).collect()
    }

    async fn take_deliveries(
        &self,
        limit: i64,
        hold: Duration,
        except: &[String],
    ) -> Result<Vec<DueDelivery>, StoreError> {
        let mut tx = self.begin().await?;
        let query = sqlx::query_as(TAKE).bind(hold.as_millis() as i64).bind(serde_json::to_string(except)?).bind(limit);
        let taken: Vec<(String, String, String, i64, String, String)> = query.fetch_all(&mut *tx).await?;
        tx.commit().await?;
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
        let mut tx = self.begin().await?;
        let forget = sqlx::query(FORGET).bind(age.as_millis() as i64).bind(limit);
        let forgotten = forget.execute(&mut *tx).await?.rows_affected();
        tx.commit().await?;
        Ok(forgotten)
    }

    async fn settle_delivery(&self, id: &str, attempt: i64, outcome: &Delivered) -> Result<bool, StoreError> {
        let (status, delay, error) = match outcome {
            Delivered::Yes => ("delivered", None, None),
            Delivered::NotYet(delay, error) => ("pending", Some(delay.as_millis() as i64), Some(error)),
            Delivered::Never(error) => ("failed", None, Some(error)),
        };
        let mut tx = self.begin().await?;
        let update = sqlx::query(SETTLE).bind(status).bind(delay).bind(error).bind(id).bind(attempt);
        let settled = update.execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(settled)
    }
}
