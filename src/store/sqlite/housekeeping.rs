//! Lapsed leases, deadlines, readiness, counts.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::{AssertSqlSafe, Sqlite, Transaction};

use super::rows::{self, JOB, MAP};
use super::{SqliteStore, now};
use crate::jobs::lifecycle::{Verdict, past_deadline};
use crate::jobs::{MapRecord, ProblemReport};
use crate::store::{Holdings, Housekeeping, Judge, LIGHT, StoreError, Totals, Written};

const LAPSED: &str = concat!(" FROM jobs WHERE status = 'running' AND lease_until < ", now!());
const OVERDUE: &str = concat!(
    "SELECT id FROM jobs WHERE deadline IS NOT NULL AND status IN ('accepted', 'running') AND deadline < ",
    now!(),
    " ORDER BY deadline LIMIT 1000"
);
const FAIL: &str = concat!(
    "UPDATE jobs SET status = 'failed', revision = revision + 1, lease_until = NULL, problem = ?, finished = ",
    now!(),
    ", updated = ",
    now!(),
    " WHERE id = ?"
);
const AGAIN: &str = concat!(
    "UPDATE jobs SET status = 'accepted', revision = revision + 1, lease_until = NULL, message = ?, progress = ?, updated = ",
    now!(),
    " WHERE id = ?"
);
const OWNED: &str = "SELECT EXISTS (SELECT 1 FROM maps WHERE maps.prefix = asked.value ->> 0) \
                     OR EXISTS (SELECT 1 FROM jobs WHERE jobs.id = asked.value ->> 1 \
                                AND jobs.attempt = asked.value ->> 2 AND jobs.status = 'running') \
                     FROM json_each(?) AS asked ORDER BY asked.key";
const READ: &str = "SELECT (SELECT id FROM turns LIMIT 1), (SELECT max(id) FROM jobs), (SELECT max(id) FROM maps)";
const WRITE: &str = concat!(
    "INSERT INTO probes (id, written) VALUES (1, ",
    now!(),
    ") ON CONFLICT (id) DO UPDATE SET written = excluded.written"
);
const OLD: &str = concat!(
    " FROM maps WHERE (created, id) > (?, ?) AND created < ",
    now!(),
    " - ? AND NOT EXISTS (SELECT 1 FROM place_versions WHERE map_id = maps.id) ORDER BY created, id LIMIT ?"
);
const HOLDINGS: &str = "SELECT queued, running, maps, bytes FROM holdings WHERE tenant = ?";
const TOTALS: &str =
    "SELECT queued > ? AS heavy, sum(queued), sum(running), sum(maps), sum(bytes) FROM holdings GROUP BY heavy";
const OLDEST: &str = concat!(
    "SELECT queued > ? AS heavy, ",
    now!(),
    " - min(turns.created) FROM turns JOIN holdings ON holdings.tenant = turns.tenant GROUP BY heavy"
);

#[async_trait]
impl Housekeeping for SqliteStore {
    async fn reap(&self, verdict: Judge) -> Result<u64, StoreError> {
        let mut tx = self.begin().await?;
        let overdue: Vec<String> = sqlx::query_scalar(OVERDUE).fetch_all(&mut *tx).await?;
        for id in &overdue {
            fail(&mut tx, id, &past_deadline()).await?;
        }
        let lapsed = sqlx::query(AssertSqlSafe(format!("SELECT {JOB}{LAPSED}"))).fetch_all(&mut *tx).await?;
        for row in &lapsed {
            let job = rows::job(row)?;
            match verdict(&job) {
                Verdict::Failed(problem) => fail(&mut tx, &job.id, &problem).await?,
                Verdict::Again(message) => {
                    let progress = serde_json::to_string(&job.progress.again())?;
                    sqlx::query(AGAIN).bind(message).bind(progress).bind(&job.id).execute(&mut *tx).await?;
                }
            }
        }
        tx.commit().await?;
        Ok((overdue.len() + lapsed.len()) as u64)
    }

    async fn owned(&self, written: &[Written]) -> Result<Vec<bool>, StoreError> {
        let asked: Vec<_> = written.iter().map(|one| (&one.prefix, &one.job_id, one.attempt)).collect();
        let asked = serde_json::to_string(&asked)?;
        Ok(sqlx::query_scalar(OWNED).bind(asked).fetch_all(&self.readers).await?)
    }

    async fn probe(&self) -> Result<(), StoreError> {
        sqlx::query(READ).fetch_one(&self.readers).await?;
        let mut tx = self.begin().await?;
        sqlx::query(WRITE).execute(&mut *tx).await?;
        Ok(tx.commit().await?)
    }

    async fn maps_older_than(
        &self,
        age: Duration,
        (created, id): (i64, &str),
        limit: i64,
    ) -> Result<Vec<(MapRecord, Duration)>, StoreError> {
        let query = format!("SELECT {MAP}, {} - created AS age{OLD}", now!());
        let query = sqlx::query(AssertSqlSafe(query)).bind(created).bind(id).bind(age.as_millis() as i64);
        query.bind(limit).fetch_all(&self.readers).await?.iter().map(rows::aged_map).collect()
    }

    async fn holdings(&self, tenant: &str) -> Result<Holdings, StoreError> {
        let held = sqlx::query_as(HOLDINGS).bind(tenant).fetch_optional(&self.readers).await?;
        Ok(held.map(holdings).unwrap_or_default())
    }

    async fn totals(&self) -> Result<Totals, StoreError> {
        let held = sqlx::query_as(TOTALS).bind(LIGHT).fetch_all(&self.readers).await?;
        Ok(Totals::of(held, sqlx::query_as(OLDEST).bind(LIGHT).fetch_all(&self.readers).await?))
    }
}

fn holdings((queued, running, maps, bytes): (i64, i64, i64, i64)) -> Holdings {
    Holdings { queued, running, maps, bytes }
}

async fn fail(tx: &mut Transaction<'static, Sqlite>, id: &str, problem: &ProblemReport) -> Result<(), StoreError> {
    sqlx::query(FAIL).bind(serde_json::to_string(problem)?).bind(id).execute(&mut **tx).await?;
    Ok(())
}
