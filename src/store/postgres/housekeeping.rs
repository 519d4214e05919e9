//! Lapsed leases, deadlines, readiness, counts.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::AssertSqlSafe;

use super::rows::{self, JOB, MAP};
use super::{PostgresStore, now};
use crate::jobs::MapRecord;
use crate::jobs::lifecycle::{Verdict, past_deadline};
use crate::store::{Holdings, Housekeeping, Judge, LIGHT, StoreError, Totals, Written};

/// Jobs failed for their deadline by one statement, and how many such statements a reaping makes.
const BATCH: i64 = 100;
const BATCHES: usize = 10;

const LAPSED: &str = concat!(
    " FROM leases AS l JOIN jobs AS j ON j.id = l.job_id WHERE l.lease_until < ",
    now!(),
    " ORDER BY l.lease_until LIMIT 1000"
);
const OVERDUE: &str = concat!(
    "WITH due AS MATERIALIZED (SELECT id FROM jobs WHERE deadline IS NOT NULL AND status IN ('accepted', 'running') \
     AND deadline < ",
    now!(),
    " ORDER BY deadline LIMIT $2 FOR UPDATE SKIP LOCKED) \
     UPDATE jobs SET status = 'failed', revision = revision + 1, problem = $1, finished = ",
    now!(),
    ", updated = ",
    now!(),
    " FROM due WHERE jobs.id = due.id"
);

/// A rescue begins and ends like this. It holds the job, then the lease, and looks whether that has lapsed once it is held: one
/// that was renewed, ended or rescued meanwhile stays as it is.
macro_rules! rescued {
    ($($assignment:expr),+) => {
        concat!("WITH held AS MATERIALIZED (SELECT id FROM jobs WHERE id = $1 AND attempt = $2 AND status = 'running' \
                 FOR UPDATE SKIP LOCKED), lapsed AS MATERIALIZED (SELECT l.job_id FROM leases AS l \
                 JOIN held ON held.id = l.job_id WHERE l.attempt = $2 AND l.lease_until < ", now!(), " FOR UPDATE OF l) \
                 UPDATE jobs SET revision = revision + 1, updated = ", now!(), ", ", $($assignment),+,
                " FROM lapsed WHERE jobs.id = lapsed.job_id")
    };
}
const FAIL: &str = rescued!("status = 'failed', problem = $3, finished = ", now!());
const AGAIN: &str = rescued!("status = 'accepted', message = $3, progress = $4");
const OWNED: &str = "SELECT EXISTS (SELECT 1 FROM maps WHERE maps.prefix = asked.prefix) \
                     OR EXISTS (SELECT 1 FROM jobs WHERE jobs.id = asked.job_id AND jobs.attempt = asked.attempt \
                                AND jobs.status = 'running') \
                     FROM unnest($1::text[], $2::text[], $3::bigint[]) WITH ORDINALITY \
                          AS asked (prefix, job_id, attempt, place) ORDER BY asked.place";
const READ: &str = "SELECT (SELECT id FROM lanes LIMIT 1), (SELECT max(id) FROM jobs), (SELECT max(id) FROM maps)";
const WRITE: &str = concat!(
    "INSERT INTO probes (id, written) VALUES (1, ",
    now!(),
    ") ON CONFLICT (id) DO UPDATE SET written = excluded.written"
);
const OLD: &str = concat!(
    " FROM maps AS m WHERE (m.created, m.id) > ($1, $2) AND m.created < ",
    now!(),
    " - $3 AND NOT EXISTS (SELECT 1 FROM place_versions WHERE map_id = m.id) ORDER BY m.created, m.id LIMIT $4"
);
const HOLDINGS: &str = "SELECT COALESCE(sum(queued), 0)::bigint, (SELECT count(*) FROM leases WHERE tenant = $1), \
                        COALESCE(sum(maps), 0)::bigint, COALESCE(sum(bytes), 0)::bigint FROM holdings WHERE tenant = $1";
const TOTALS: &str = "SELECT held.queued > $1, sum(held.queued)::bigint, COALESCE(sum(busy.running), 0)::bigint, \
                      sum(held.maps)::bigint, sum(held.bytes)::bigint \
                      FROM (SELECT tenant, sum(queued) AS queued, sum(maps) AS maps, sum(bytes) AS bytes \
                            FROM holdings GROUP BY tenant) AS held \
                      LEFT JOIN (SELECT tenant, count(*) AS running FROM leases GROUP BY tenant) AS busy \
                      ON busy.tenant = held.tenant GROUP BY 1";
/// A lane's own time is a hint, so the head of each queue is looked at.
const OLDEST: &str = concat!(
    "SELECT held.queued > $1, ",
    now!(),
    " - min(head.created) FROM lanes CROSS JOIN LATERAL (SELECT created FROM jobs WHERE status = 'accepted' AND \
     not_before = 0 AND tenant = lanes.tenant AND priority = lanes.priority ORDER BY created, id LIMIT 1) AS head \
     JOIN (SELECT tenant, sum(queued) AS queued FROM holdings GROUP BY tenant) AS held ON held.tenant = lanes.tenant \
     GROUP BY 1"
);

#[async_trait]
impl Housekeeping for PostgresStore {
    async fn reap(&self, verdict: Judge) -> Result<u64, StoreError> {
        let mut reaped = self.fail_overdue().await?;
        let lapsed = sqlx::query(AssertSqlSafe(format!("SELECT {JOB}{LAPSED}"))).fetch_all(&self.pool).await?;
        // A transaction each: none holds one job and waits for another.
        for row in &lapsed {
            let job = rows::job(row)?;
            let rescue = match verdict(&job) {
                Verdict::Failed(problem) => {
                    sqlx::query(FAIL).bind(&job.id).bind(job.attempt).bind(serde_json::to_string(&problem)?)
                }
                Verdict::Again(message) => {
                    let progress = serde_json::to_string(&job.progress.again())?;
                    sqlx::query(AGAIN).bind(&job.id).bind(job.attempt).bind(message).bind(progress)
                }
            };
            reaped += rescue.execute(&self.pool).await?.rows_affected();
        }
        Ok(reaped)
    }

    async fn owned(&self, written: &[Written]) -> Result<Vec<bool>, StoreError> {
        let texts = |of: fn(&Written) -> &str| written.iter().map(|one| of(one).to_owned()).collect::<Vec<_>>();
        let attempts: Vec<i64> = written.iter().map(|one| one.attempt).collect();
        let query = sqlx::query_scalar(OWNED).bind(texts(|one| &one.prefix)).bind(texts(|one| &one.job_id));
        Ok(query.bind(attempts).fetch_all(&self.pool).await?)
    }

    async fn probe(&self) -> Result<(), StoreError> {
        sqlx::query(READ).fetch_one(&self.pool).await?;
        sqlx::query(WRITE).execute(&self.pool).await?;
        Ok(())
    }

    async fn maps_older_than(
        &self,
        age: Duration,
        (created, id): (i64, &str),
        limit: i64,
    ) -> Result<Vec<(MapRecord, Duration)>, StoreError> {
        let query = format!("SELECT {MAP}, {} - m.created AS age{OLD}", now!());
        let query = sqlx::query(AssertSqlSafe(query)).bind(created).bind(id).bind(age.as_millis() as i64);
        query.bind(limit).fetch_all(&self.pool).await?.iter().map(rows::aged_map).collect()
    }

    async fn holdings(&self, tenant: &str) -> Result<Holdings, StoreError> {
        Ok(holdings(sqlx::query_as(HOLDINGS).bind(tenant).fetch_one(&self.pool).await?))
    }

    async fn totals(&self) -> Result<Totals, StoreError> {
        let held = sqlx::query_as(TOTALS).bind(LIGHT).fetch_all(&self.pool).await?;
        Ok(Totals::of(held, sqlx::query_as(OLDEST).bind(LIGHT).fetch_all(&self.pool).await?))
    }
}

impl PostgresStore {
    /// Fails the jobs that are past their deadline, those that wait and those that run; how many.
    async fn fail_overdue(&self) -> Result<u64, StoreError> {
        let problem = serde_json::to_string(&past_deadline())?;
        let mut failed = 0;
        for _ in 0..BATCHES {
            let overdue = sqlx::query(OVERDUE).bind(&problem).bind(BATCH).execute(&self.pool).await?.rows_affected();
            failed += overdue;
            if overdue < BATCH as u64 {
                break;
            }
        }
        Ok(failed)
    }
}

fn holdings((queued, running, maps, bytes): (i64, i64, i64, i64)) -> Holdings {
    Holdings { queued, running, maps, bytes }
}
