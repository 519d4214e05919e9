//! Jobs as clients see them.

use async_trait::async_trait;
use sqlx::postgres::{PgConnection, PgRow};
use sqlx::{AssertSqlSafe, Connection};
use uuid::Uuid;

use super::rows::{self, JOB, LEASE};
use super::{PostgresStore, listed, now};
use crate::jobs::{Job, JobStatus};
use crate::store::{Cancellation, JobBoard, Listing, NewJob, Quota, Relabelling, Removal, StoreError, Submission};

/// A quota is exact as long as no more submissions of a tenant than this are under way at once: so near to it they queue.
const MARGIN: i64 = 64;
/// How often a submission looks again whether another brought its key first.
const TRIES: usize = 3;

const KNOWN_KEY: &str = "SELECT body, job_id FROM idempotency_keys WHERE tenant = $1 AND key = $2";
const HELD: &str =
    "SELECT COALESCE(sum(queued), 0)::bigint, COALESCE(sum(bytes), 0)::bigint FROM holdings WHERE tenant = $1";
const QUOTA_LOCK: &str = "SELECT pg_advisory_xact_lock(quota_key($1))";
/// One statement, so that it commits by itself; a trigger tells who listens.
const INSERT: &str = "WITH clock AS MATERIALIZED (SELECT now_ms() AS at), \
     keyed AS (INSERT INTO idempotency_keys (tenant, key, body, job_id) \
               SELECT $2, $11, $12, $1 WHERE $11 IS NOT NULL), \
     kept AS (INSERT INTO requests (job_id, request) VALUES ($1, $10)), \
     j AS (INSERT INTO jobs (id, tenant, name, labels, status, progress, message, priority, retry_of, deadline, \
                             traceparent, created, updated) \
           SELECT $1, $2, $3, $4, 'accepted', $5, $6, $7, $8, at + $9, $13, at, at FROM clock RETURNING *) SELECT ";
const REQUEST: &str = "SELECT requests.request FROM jobs JOIN requests ON requests.job_id = jobs.id \
                       WHERE jobs.id = $1 AND jobs.tenant = $2";
const DISMISS: &str = concat!(
    "UPDATE jobs SET status = 'dismissed', revision = revision + 1, finished = ",
    now!(),
    ", updated = ",
    now!(),
    " WHERE id = $1 AND tenant = $2 AND status IN ('accepted', 'running')"
);
const RELABEL: &str = concat!(
    "UPDATE jobs SET name = CASE WHEN $3 THEN $4 ELSE name END, labels = COALESCE($5, labels), revision = revision + 1, updated = ",
    now!(),
    " WHERE id = $1 AND tenant = $2"
);
/// With its request and its key, which go by themselves.
const REMOVE: &str = "DELETE FROM jobs WHERE id = $1 AND tenant = $2 AND status IN ('successful', 'failed', 'dismissed') \
                      AND NOT EXISTS (SELECT 1 FROM maps WHERE job_id = $1)";
const REVISIONS: &str = "SELECT j.id, j.revision + COALESCE(l.beats, 0) FROM jobs AS j \
                         LEFT JOIN leases AS l ON l.job_id = j.id WHERE j.id = ANY($1)";

#[async_trait]
impl JobBoard for PostgresStore {
    async fn submit(&self, new: NewJob) -> Result<Submission, StoreError> {
        let mut tries = TRIES;
        loop {
            if let Some(known) = self.known(&new).await? {
                return Ok(known);
            }
            match self.accept(&new).await {
                // Another submission brought the key between the look and the insert, and has committed.
                Err(StoreError::Database(error)) if tries > 0 && is_repeat(&error) => tries -= 1,
                outcome => return outcome,
            }
        }
    }

    async fn job(&self, tenant: &str, id: &str) -> Result<Option<Job>, StoreError> {
        let query = format!("SELECT {JOB} FROM jobs AS j{LEASE} WHERE j.id = $1 AND j.tenant = $2");
        let query = sqlx::query(AssertSqlSafe(query)).bind(id).bind(tenant);
        query.fetch_optional(&self.pool).await?.as_ref().map(rows::job).transpose()
    }

    async fn jobs(&self, listing: &Listing) -> Result<Vec<Job>, StoreError> {
        let mut query = listed::page(&listed::JOBS, listing);
        query.build().fetch_all(&self.pool).await?.iter().map(rows::job).collect()
    }

    async fn request(&self, tenant: &str, id: &str) -> Result<Option<Vec<u8>>, StoreError> {
        Ok(sqlx::query_scalar(REQUEST).bind(id).bind(tenant).fetch_optional(&self.pool).await?)
    }

    async fn cancel(&self, tenant: &str, id: &str) -> Result<Cancellation, StoreError> {
        let dismissed = sqlx::query(DISMISS).bind(id).bind(tenant).execute(&self.pool).await?.rows_affected() == 1;
        Ok(match (self.job(tenant, id).await?, dismissed) {
            (Some(job), true) => Cancellation::Dismissed(job),
            (Some(job), false) => Cancellation::AlreadyEnded(job),
            (None, _) => Cancellation::Unknown,
        })
    }

    async fn relabel_job(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<Job>, StoreError> {
        let labels = change.labels.as_ref().map(serde_json::to_string).transpose()?;
        let update = sqlx::query(RELABEL).bind(id).bind(tenant);
        let update = update.bind(change.name.is_some()).bind(change.name.clone().flatten()).bind(labels);
        update.execute(&self.pool).await?;
        self.job(tenant, id).await
    }

    async fn remove_job(&self, tenant: &str, id: &str) -> Result<Removal, StoreError> {
        let removed = sqlx::query(REMOVE).bind(id).bind(tenant).execute(&self.pool).await?.rows_affected();
        if removed == 1 {
            return Ok(Removal::Removed);
        }
        Ok(match self.job(tenant, id).await? {
            None => Removal::Unknown,
            Some(Job { status: JobStatus::Successful, map_id: Some(map), .. }) => Removal::HasMap(map),
            Some(_) => Removal::NotEnded,
        })
    }

    async fn revisions(&self, ids: &[String]) -> Result<Vec<(String, i64)>, StoreError> {
        Ok(sqlx::query_as(REVISIONS).bind(ids).fetch_all(&self.pool).await?)
    }
}

impl PostgresStore {
    /// What a submission comes to whose key was here before.
    async fn known(&self, new: &NewJob) -> Result<Option<Submission>, StoreError> {
        let Some((key, body)) = &new.idempotency else { return Ok(None) };
        let known = sqlx::query_as(KNOWN_KEY).bind(&new.tenant).bind(key).fetch_optional(&self.pool).await?;
        let Some((known_body, job_id)): Option<(String, String)> = known else { return Ok(None) };
        if known_body != *body {
            return Ok(Some(Submission::KeyReused));
        }
        // A job that is removed in this moment takes its key with it.
        Ok(self.job(&new.tenant, &job_id).await?.map(Submission::Repeated))
    }

    async fn accept(&self, new: &NewJob) -> Result<Submission, StoreError> {
        let mut connection = self.pool.acquire().await?;
        let Some(quota) = new.quota else {
            return Ok(Submission::Accepted(insert(&mut connection, new).await?));
        };
        let (queued, bytes) = held(&mut connection, &new.tenant).await?;
        if let Some(what) = over(quota, queued, bytes) {
            return Ok(Submission::OverQuota(what));
        }
        if queued < quota.queued.saturating_sub(MARGIN) {
            return Ok(Submission::Accepted(insert(&mut connection, new).await?));
        }
        let mut tx = connection.begin().await?;
        sqlx::query(QUOTA_LOCK).bind(&new.tenant).execute(&mut *tx).await?;
        let (queued, bytes) = held(&mut tx, &new.tenant).await?;
        if let Some(what) = over(quota, queued, bytes) {
            return Ok(Submission::OverQuota(what));
        }
        let job = insert(&mut tx, new).await?;
        tx.commit().await?;
        Ok(Submission::Accepted(job))
    }
}

/// How many jobs of a tenant wait, and the bytes of its maps.
async fn held(connection: &mut PgConnection, tenant: &str) -> Result<(i64, i64), StoreError> {
    Ok(sqlx::query_as(HELD).bind(tenant).fetch_one(connection).await?)
}

/// What a tenant has as much of as it may.
fn over(quota: Quota, queued: i64, bytes: i64) -> Option<&'static str> {
    match (queued >= quota.queued, bytes >= quota.bytes) {
        (true, _) => Some("queued jobs"),
        (_, true) => Some("bytes of maps"),
        _ => None,
    }
}

async fn insert(connection: &mut PgConnection, new: &NewJob) -> Result<Job, StoreError> {
    let (key, body) = new.idempotency.as_ref().map(|(key, body)| (key, body)).unzip();
    let insert = sqlx::query(AssertSqlSafe(format!("{INSERT}{JOB} FROM j{LEASE}")));
    let insert = insert.bind(Uuid::now_v7().to_string()).bind(&new.tenant).bind(&new.name);
    let insert = insert.bind(serde_json::to_string(&new.labels)?).bind(serde_json::to_string(&new.progress)?);
    let insert = insert.bind(&new.message).bind(new.priority).bind(&new.retry_of);
    // The sum of a time and nothing is nothing.
    let insert = insert.bind(new.deadline_seconds.map(|seconds| (seconds * 1000.0) as i64));
    let insert = insert.bind(&new.request[..]).bind(key).bind(body).bind(&new.traceparent);
    // All rows, though there is one: only then is the commit known of.
    let rows: Vec<PgRow> = insert.fetch_all(connection).await?;
    rows.first().map_or_else(|| Err(sqlx::Error::RowNotFound.into()), rows::job)
}

/// Whether a key is there already.
fn is_repeat(error: &sqlx::Error) -> bool {
    error.as_database_error().is_some_and(|error| error.is_unique_violation())
}
