//! Parts of jobs.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::Row;
use sqlx::postgres::PgRow;

use super::leases::millis;
use super::{PostgresStore, now};
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
            "WHERE prefix = $1 AND number = $2 AND claim = $3 AND NOT delivered AND lease_until > ",
            now!(),
            " AND ",
            runs!()
        )
    };
}
/// What earlier passes, and earlier attempts, left.
const FORGET: &str = "DELETE FROM parts WHERE job_id = $1 AND attempt <= $2";
/// Those who wait for jobs hear of parts, too.
const OFFER: &str = "WITH offered AS (INSERT INTO parts (prefix, number, job_id, attempt) \
    SELECT $1, n, jobs.id, jobs.attempt FROM generate_series(0, $2 - 1) AS n, jobs \
    WHERE jobs.id = $3 AND jobs.attempt = $4 AND jobs.status = 'running' RETURNING number) \
    SELECT count(*), pg_notify('mapfit_jobs', '') FROM offered";
const PARTS: &str = concat!(
    "SELECT prefix, number, claim, delivered, lease_until > ",
    now!(),
    " AS taken FROM parts WHERE prefix = $1 ORDER BY number"
);
const KEEP: &str =
    concat!("DELETE FROM parts WHERE prefix = $1 AND number = $2 AND NOT delivered AND lease_until <= ", now!());
const SEND: &str = concat!("UPDATE parts SET sent = true ", held!());
const WITHDRAW: &str = "DELETE FROM parts WHERE prefix = $1";
/// What failed twice is its attempt's.
const TAKE: &str = concat!(
    "UPDATE parts SET claim = claim + 1, sent = false, worker = $1, lease_until = ",
    now!(),
    " + $2 WHERE (prefix, number) = (SELECT prefix, number FROM parts WHERE NOT delivered AND claim < 2 AND lease_until <= ",
    now!(),
    " AND ",
    runs!(),
    " ORDER BY prefix, number DESC LIMIT 1 FOR UPDATE SKIP LOCKED) RETURNING prefix, number, claim"
);
const HOLD: &str = concat!("UPDATE parts SET lease_until = ", now!(), " + $4 ", held!(), " RETURNING sent");
const DELIVER: &str = concat!("UPDATE parts SET delivered = true ", held!());

fn part(row: &PgRow) -> Result<Part, StoreError> {
    Ok(Part { prefix: row.try_get("prefix")?, number: row.try_get("number")?, claim: row.try_get("claim")? })
}

#[async_trait]
impl PartBoard for PostgresStore {
    async fn offer_parts(&self, pass: &Pass, count: usize) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        sqlx::query(FORGET).bind(&pass.job_id).bind(pass.attempt).execute(&mut *tx).await?;
        let offer = sqlx::query(OFFER).bind(&pass.prefix).bind(i64::try_from(count).unwrap_or(i64::MAX));
        let row = offer.bind(&pass.job_id).bind(pass.attempt).fetch_one(&mut *tx).await?;
        let offered: i64 = row.try_get(0)?;
        tx.commit().await?;
        Ok(offered > 0)
    }

    async fn parts_of(&self, prefix: &str) -> Result<Vec<(Part, Standing)>, StoreError> {
        let rows = sqlx::query(PARTS).bind(prefix).fetch_all(&self.pool).await?;
        let standing = |row: &PgRow| -> Result<_, StoreError> {
            Ok((part(row)?, Standing::of(row.try_get("taken")?, row.try_get("delivered")?)))
        };
        rows.iter().map(standing).collect()
    }

    async fn keep_part(&self, prefix: &str, number: i64) -> Result<bool, StoreError> {
        Ok(sqlx::query(KEEP).bind(prefix).bind(number).execute(&self.pool).await?.rows_affected() == 1)
    }

    async fn send_part(&self, part: &Part) -> Result<bool, StoreError> {
        self.of_held(SEND, part).await
    }

    async fn withdraw_parts(&self, prefix: &str) -> Result<(), StoreError> {
        sqlx::query(WITHDRAW).bind(prefix).execute(&self.pool).await?;
        Ok(())
    }

    async fn take_part(&self, worker: &str, lease: Duration) -> Result<Option<Part>, StoreError> {
        let rows = sqlx::query(TAKE).bind(worker).bind(millis(lease)).fetch_all(&self.pool).await?;
        rows.first().map(part).transpose()
    }

    async fn hold_part(&self, part: &Part, lease: Duration) -> Result<Hold, StoreError> {
        let hold = sqlx::query_scalar(HOLD).bind(&part.prefix).bind(part.number).bind(part.claim).bind(millis(lease));
        let sent: Vec<bool> = hold.fetch_all(&self.pool).await?;
        Ok(Hold::of(sent.first().copied()))
    }

    async fn deliver_part(&self, part: &Part) -> Result<bool, StoreError> {
        self.of_held(DELIVER, part).await
    }
}

impl PostgresStore {
    /// A write to a part that is held, and whether it was.
    async fn of_held(&self, update: &'static str, part: &Part) -> Result<bool, StoreError> {
        let update = sqlx::query(update).bind(&part.prefix).bind(part.number).bind(part.claim);
        Ok(update.execute(&self.pool).await?.rows_affected() == 1)
    }
}
