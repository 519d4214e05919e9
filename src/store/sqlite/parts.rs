//! Parts of jobs.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::leases::millis;
use super::{SqliteStore, now};
use crate::store::{Hold, Part, PartBoard, Pass, Standing, StoreError};

/// That the attempt which offered a part runs.
macro_rules! runs {
    () => {
        "EXISTS (SELECT 1 FROM jobs WHERE jobs.id = parts.job_id AND jobs.attempt = parts.attempt AND status = 'running')"
    };
}
/// That it is held, under a claim.
macro_rules! held {
    () => {
        concat!(
            "WHERE prefix = ? AND number = ? AND claim = ? AND delivered = 0 AND lease_until > ",
            now!(),
            " AND ",
            runs!()
        )
    };
}
/// What earlier passes, and earlier attempts, left.
const FORGET: &str = "DELETE FROM parts WHERE job_id = ? AND attempt <= ?";
const OFFER: &str = "WITH RECURSIVE numbers (n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM numbers WHERE n + 1 < ?) \
    INSERT INTO parts (prefix, number, job_id, attempt) SELECT ?, n, jobs.id, jobs.attempt FROM numbers, jobs \
    WHERE jobs.id = ? AND jobs.attempt = ? AND jobs.status = 'running'";
const PARTS: &str = concat!(
    "SELECT prefix, number, claim, delivered, lease_until > ",
    now!(),
    " AS taken FROM parts WHERE prefix = ? ORDER BY number"
);
const KEEP: &str =
    concat!("DELETE FROM parts WHERE prefix = ? AND number = ? AND delivered = 0 AND lease_until <= ", now!());
const SEND: &str = concat!("UPDATE parts SET sent = 1 ", held!());
const WITHDRAW: &str = "DELETE FROM parts WHERE prefix = ?";
/// What a worker may take: what failed twice is its attempt's.
macro_rules! free {
    () => {
        concat!("FROM parts WHERE delivered = 0 AND claim < 2 AND lease_until <= ", now!(), " AND ", runs!())
    };
}
const ANY: &str = concat!("SELECT 1 ", free!(), " LIMIT 1");
const TAKE: &str = concat!(
    "UPDATE parts SET claim = claim + 1, sent = 0, worker = ?, lease_until = ",
    now!(),
    " + ? WHERE (prefix, number) = (SELECT prefix, number ",
    free!(),
    " ORDER BY prefix, number DESC LIMIT 1) RETURNING prefix, number, claim"
);
const HOLD: &str = concat!("UPDATE parts SET lease_until = ", now!(), " + ? ", held!(), " RETURNING sent");
const DELIVER: &str = concat!("UPDATE parts SET delivered = 1 ", held!());

fn part(row: &SqliteRow) -> Result<Part, StoreError> {
    Ok(Part { prefix: row.try_get("prefix")?, number: row.try_get("number")?, claim: row.try_get("claim")? })
}

#[async_trait]
impl PartBoard for SqliteStore {
    async fn offer_parts(&self, pass: &Pass, count: usize) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        sqlx::query(FORGET).bind(&pass.job_id).bind(pass.attempt).execute(&mut *tx).await?;
        let offer = sqlx::query(OFFER).bind(i64::try_from(count).unwrap_or(i64::MAX)).bind(&pass.prefix);
        let offered = offer.bind(&pass.job_id).bind(pass.attempt).execute(&mut *tx).await?.rows_affected();
        tx.commit().await?;
        Ok(offered > 0)
    }

    async fn parts_of(&self, prefix: &str) -> Result<Vec<(Part, Standing)>, StoreError> {
        let rows = sqlx::query(PARTS).bind(prefix).fetch_all(&self.readers).await?;
        let standing = |row: &SqliteRow| -> Result<_, StoreError> {
            Ok((part(row)?, Standing::of(row.try_get("taken")?, row.try_get("delivered")?)))
        };
        rows.iter().map(standing).collect()
    }

    async fn keep_part(&self, prefix: &str, number: i64) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let kept = sqlx::query(KEEP).bind(prefix).bind(number).execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(kept)
    }

    async fn send_part(&self, part: &Part) -> Result<bool, StoreError> {
        self.of_held(SEND, part).await
    }

    async fn withdraw_parts(&self, prefix: &str) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        sqlx::query(WITHDRAW).bind(prefix).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(())
    }

    async fn take_part(&self, worker: &str, lease: Duration) -> Result<Option<Part>, StoreError> {
        // Whoever has nothing to do asks twice a second: without a writer's turn, as long as there is nothing.
        if sqlx::query(ANY).fetch_optional(&self.readers).await?.is_none() {
            return Ok(None);
        }
        let mut tx = self.begin().await?;
        let rows = sqlx::query(TAKE).bind(worker).bind(millis(lease)).fetch_all(&mut *tx).await?;
        tx.commit().await?;
        rows.first().map(part).transpose()
    }

    async fn hold_part(&self, part: &Part, lease: Duration) -> Result<Hold, StoreError> {
        let mut tx = self.begin().await?;
        let hold = sqlx::query_scalar(HOLD).bind(millis(lease)).bind(&part.prefix).bind(part.number).bind(part.claim);
        let sent: Vec<bool> = hold.fetch_all(&mut *tx).await?;
        tx.commit().await?;
        Ok(Hold::of(sent.first().copied()))
    }

    async fn deliver_part(&self, part: &Part) -> Result<bool, StoreError> {
        self.of_held(DELIVER, part).await
    }
}

impl SqliteStore {
    /// A write to a part that is held, and whether it was.
    async fn of_held(&self, update: &'static str, part: &Part) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let update = sqlx::query(update).bind(&part.prefix).bind(part.number).bind(part.claim);
        let held = update.execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(held)
    }
}
