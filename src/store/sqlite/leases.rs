//! Jobs as workers hold them.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::{AssertSqlSafe, Sqlite, Transaction};

use super::rows::{self, JOB};
use super::{SqliteStore, now};
use crate::jobs::{MapRecord, ProblemReport, Progress};
use crate::store::{Claim, Leases, StoreError, Terms};

/// Retried jobs that a claim puts back in the queue at most.
const MOST_DUE: i64 = 32;
const DUE: &str = concat!(
    "UPDATE jobs SET not_before = 0 WHERE id IN (SELECT id FROM jobs WHERE status = 'accepted' AND not_before > 0 \
     AND not_before <= ",
    now!(),
    " ORDER BY not_before LIMIT ?)"
);
const CLAIM: &str = concat!(
    "UPDATE jobs SET status = 'running', attempt = attempt + 1, revision = revision + 1, worker = ?, lease_until = ",
    now!(),
    " + ?, updated = ",
    now!(),
    ", started = COALESCE(started, ",
    now!(),
    ") WHERE id = (SELECT id FROM turns WHERE running < ? ORDER BY priority DESC, running, served, created, id LIMIT 1) \
     RETURNING "
);
const REQUEST: &str = "SELECT request FROM requests WHERE job_id = ?";

/// Every fenced write begins and ends like this.
macro_rules! fenced {
    ($($assignment:expr),+) => {
        concat!("UPDATE jobs SET revision = revision + 1, updated = ", now!(), ", ", $($assignment),+,
                " WHERE id = ? AND attempt = ? AND status = 'running'")
    };
}
const BEAT: &str = fenced!("progress = ?, lease_until = ", now!(), " + ?");
const SUCCEED: &str =
    fenced!("status = 'successful', lease_until = NULL, map_id = ?, progress = ?, finished = ", now!());
const FAIL: &str = fenced!("status = 'failed', lease_until = NULL, problem = ?, finished = ", now!());
const RETRY: &str =
    fenced!("status = 'accepted', lease_until = NULL, message = ?, progress = ?, not_before = ", now!(), " + ?");
const RELEASE: &str = fenced!("status = 'accepted', lease_until = NULL, attempt = attempt - 1, progress = ?");
const INSERT_MAP: &str = concat!(
    "INSERT INTO maps (id, job_id, tenant, name, labels, distance, lattice, fit, min_x, min_y, max_x, max_y, prefix, \
     bytes, sha256, parent, version, created) SELECT ?, id, tenant, name, labels, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ",
    now!(),
    " FROM jobs WHERE id = ?"
);

impl SqliteStore {
    async fn held(
        &self,
        update: sqlx::query::Query<'_, Sqlite, sqlx::sqlite::SqliteArguments>,
        (id, attempt): (&str, i64),
    ) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let held = update.bind(id.to_owned()).bind(attempt).execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(held)
    }
}

#[async_trait]
impl Leases for SqliteStore {
    async fn claim(&self, terms: &Terms) -> Result<Option<Claim>, StoreError> {
        let mut tx = self.begin().await?;
        // Retried jobs whose time has come join the queue; see the migration.
        sqlx::query(DUE).bind(MOST_DUE).execute(&mut *tx).await?;
        let claim = sqlx::query(AssertSqlSafe(format!("{CLAIM}{JOB}"))).bind(&terms.worker);
        let claim = claim.bind(millis(terms.lease)).bind(terms.running_a_tenant);
        let row = claim.fetch_all(&mut *tx).await?.into_iter().next();
        let claim = match row.as_ref().map(rows::job).transpose()? {
            Some(job) => {
                let request = sqlx::query_scalar(REQUEST).bind(&job.id).fetch_one(&mut *tx).await?;
                Some(Claim { job, request })
            }
            None => None,
        };
        tx.commit().await?;
        Ok(claim)
    }

    async fn heartbeat(
        &self,
        id: &str,
        attempt: i64,
        progress: &Progress,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        let update = sqlx::query(BEAT).bind(serde_json::to_string(progress)?).bind(millis(lease));
        self.held(update, (id, attempt)).await
    }

    async fn succeed(&self, attempt: i64, map: &MapRecord, done: &Progress) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let update = sqlx::query(SUCCEED).bind(&map.id).bind(serde_json::to_string(done)?);
        if update.bind(&map.job_id).bind(attempt).execute(&mut *tx).await?.rows_affected() != 1 {
            return Ok(false);
        }
        insert_map(&mut tx, map).await?;
        tx.commit().await?;
        Ok(true)
    }

    async fn fail(&self, id: &str, attempt: i64, problem: &ProblemReport) -> Result<bool, StoreError> {
        self.held(sqlx::query(FAIL).bind(serde_json::to_string(problem)?), (id, attempt)).await
    }

    async fn retry(
        &self,
        id: &str,
        attempt: i64,
        delay: Duration,
        message: &str,
        progress: &Progress,
    ) -> Result<bool, StoreError> {
        let update = sqlx::query(RETRY).bind(message.to_owned()).bind(serde_json::to_string(progress)?);
        self.held(update.bind(millis(delay)), (id, attempt)).await
    }

    async fn release(&self, id: &str, attempt: i64, progress: &Progress) -> Result<bool, StoreError> {
        self.held(sqlx::query(RELEASE).bind(serde_json::to_string(progress)?), (id, attempt)).await
    }
}

/// Under the name and the labels that its job has now: they may have changed since the claim.
async fn insert_map(tx: &mut Transaction<'static, Sqlite>, map: &MapRecord) -> Result<(), StoreError> {
    let bounds = map.lattice.bounds();
    let insert = sqlx::query(INSERT_MAP).bind(&map.id).bind(map.distance.name());
    let insert = insert.bind(serde_json::to_string(&map.lattice)?).bind(serde_json::to_string(&map.fit)?);
    let insert = insert.bind(bounds.min[0]).bind(bounds.min[1]).bind(bounds.max[0]).bind(bounds.max[1]);
    let insert = insert.bind(&map.prefix).bind(map.bytes).bind(&map.sha256).bind(&map.parent).bind(map.version);
    insert.bind(&map.job_id).execute(&mut **tx).await?;
    Ok(())
}

pub(super) fn millis(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX >> 1)
}
