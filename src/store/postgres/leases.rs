//! Jobs as workers hold them. Who is next is decided in the database: see `claim_job` in the migration.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::postgres::PgArguments;
use sqlx::query::Query;
use sqlx::{AssertSqlSafe, Postgres, Row};

use super::rows::{self, JOB, LEASE};
use super::{PostgresStore, now};
use crate::jobs::{MapRecord, ProblemReport, Progress};
use crate::store::{Claim, Leases, StoreError, Terms};

/// How often a claim waits for another's turn to end before it goes empty-handed.
const TURNS: usize = 32;
const CLAIM: &str = "FROM claim_job($1, $2, $3, $4) AS c CROSS JOIN LATERAL (SELECT (c.claimed).*) AS j";

/// Every fenced write begins and ends like this; a trigger ends the lease with it.
macro_rules! fenced {
    ($($assignment:expr),+) => {
        concat!("UPDATE jobs SET revision = revision + 1, updated = ", now!(), ", ", $($assignment),+,
                " WHERE id = $1 AND attempt = $2 AND status = 'running'")
    };
}
/// A lease is there exactly while its attempt runs.
const BEAT: &str = concat!(
    "UPDATE leases SET progress = $3, lease_until = ",
    now!(),
    " + $4, updated = ",
    now!(),
    ", beats = beats + 1 WHERE job_id = $1 AND attempt = $2"
);
const FAIL: &str = fenced!("status = 'failed', problem = $3, finished = ", now!());
const RETRY: &str = fenced!("status = 'accepted', message = $3, progress = $4, not_before = ", now!(), " + $5");
const RELEASE: &str = fenced!("status = 'accepted', attempt = attempt - 1, progress = $3");
/// The map is written under the name and the labels that its job has now: they may have changed since the claim.
const SUCCEED: &str = concat!(
    "WITH done AS (",
    fenced!("status = 'successful', map_id = $3, progress = $4, finished = ", now!()),
    " RETURNING id, tenant, name, labels) \
     INSERT INTO maps (id, job_id, tenant, name, labels, distance, lattice, fit, min_x, min_y, max_x, max_y, prefix, bytes, \
     sha256, parent, version, created) \
     SELECT $3, id, tenant, name, labels, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, ",
    now!(),
    " FROM done"
);

impl PostgresStore {
    async fn held(&self, update: Query<'_, Postgres, PgArguments>) -> Result<bool, StoreError> {
        Ok(update.execute(&self.pool).await?.rows_affected() == 1)
    }
}

#[async_trait]
impl Leases for PostgresStore {
    async fn claim(&self, terms: &Terms) -> Result<Option<Claim>, StoreError> {
        let query = format!("SELECT {JOB}, c.request, c.busy, (c.claimed).id IS NOT NULL AS found {CLAIM}{LEASE}");
        let mut busy: Option<String> = None;
        for _ in 0..TURNS {
            let claim = sqlx::query(AssertSqlSafe(query.clone())).bind(&terms.worker).bind(millis(terms.lease));
            let claim = claim.bind(terms.running_a_tenant).bind(&busy);
            // All rows, though there is one at most: only then is the commit known of.
            let rows = claim.fetch_all(&self.pool).await?;
            let Some(row) = rows.first() else { return Ok(None) };
            if row.try_get("found")? {
                return Ok(Some(Claim { job: rows::job(row)?, request: row.try_get("request")? }));
            }
            busy = row.try_get("busy")?;
        }
        Ok(None)
    }

    async fn heartbeat(
        &self,
        id: &str,
        attempt: i64,
        progress: &Progress,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        let update = sqlx::query(BEAT).bind(id).bind(attempt).bind(serde_json::to_string(progress)?);
        self.held(update.bind(millis(lease))).await
    }

    async fn succeed(&self, attempt: i64, map: &MapRecord, done: &Progress) -> Result<bool, StoreError> {
        let bounds = map.lattice.bounds();
        let write = sqlx::query(SUCCEED).bind(&map.job_id).bind(attempt).bind(&map.id);
        let write = write.bind(serde_json::to_string(done)?).bind(map.distance.name());
        let write = write.bind(serde_json::to_string(&map.lattice)?).bind(serde_json::to_string(&map.fit)?);
        let write = write.bind(bounds.min[0]).bind(bounds.min[1]).bind(bounds.max[0]).bind(bounds.max[1]);
        let write = write.bind(&map.prefix).bind(map.bytes).bind(&map.sha256).bind(&map.parent).bind(map.version);
        self.held(write).await
    }

    async fn fail(&self, id: &str, attempt: i64, problem: &ProblemReport) -> Result<bool, StoreError> {
        self.held(sqlx::query(FAIL).bind(id).bind(attempt).bind(serde_json::to_string(problem)?)).await
    }

    async fn retry(
        &self,
        id: &str,
        attempt: i64,
        delay: Duration,
        message: &str,
        progress: &Progress,
    ) -> Result<bool, StoreError> {
        // PostgreSQL's text has no U+0000.
        let update = sqlx::query(RETRY).bind(id).bind(attempt).bind(message.replace('\0', ""));
        self.held(update.bind(serde_json::to_string(progress)?).bind(millis(delay))).await
    }

    async fn release(&self, id: &str, attempt: i64, progress: &Progress) -> Result<bool, StoreError> {
        self.held(sqlx::query(RELEASE).bind(id).bind(attempt).bind(serde_json::to_string(progress)?)).await
    }
}

/// No longer than can be added to a time.
pub(super) fn millis(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX).min(i64::MAX >> 1)
}
