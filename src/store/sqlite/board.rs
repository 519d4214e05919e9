//! Jobs as clients see them.

use async_trait::async_trait;
use sqlx::{AssertSqlSafe, QueryBuilder, Sqlite, Transaction};
use uuid::Uuid;

use super::rows::{self, JOB};
use super::{SqliteStore, listed, now};
use crate::jobs::{Job, JobStatus};
use crate::store::{Cancellation, JobBoard, Listing, NewJob, Quota, Relabelling, Removal, StoreError, Submission};

const KNOWN_KEY: &str = "SELECT body, job_id FROM idempotency_keys WHERE tenant = ? AND key = ?";
const KEEP_KEY: &str = "INSERT INTO idempotency_keys (tenant, key, body, job_id) VALUES (?, ?, ?, ?)";
const KEEP_REQUEST: &str = "INSERT INTO requests (job_id, request) VALUES (?, ?)";
const HELD: &str = "SELECT queued, bytes FROM holdings WHERE tenant = ?";
const INSERT: &str = concat!(
    "INSERT INTO jobs (id, tenant, name, labels, status, progress, message, priority, retry_of, traceparent, deadline, created, \
     updated) VALUES (?, ?, ?, ?, 'accepted', ?, ?, ?, ?, ?, ",
    now!(),
    " + ?, ",
    now!(),
    ", ",
    now!(),
    ")"
);
const REQUEST: &str = "SELECT requests.request FROM jobs JOIN requests ON requests.job_id = jobs.id \
                       WHERE jobs.id = ? AND jobs.tenant = ?";
const DISMISS: &str = concat!(
    "UPDATE jobs SET status = 'dismissed', revision = revision + 1, lease_until = NULL, finished = ",
    now!(),
    ", updated = ",
    now!(),
    " WHERE id = ? AND tenant = ? AND status IN ('accepted', 'running')"
);
const RELABEL: &str = concat!(
    "UPDATE jobs SET name = CASE WHEN ? THEN ? ELSE name END, labels = COALESCE(?, labels), revision = revision + 1, updated = ",
    now!(),
    " WHERE id = ? AND tenant = ?"
);
const ENDED: &str = "FROM jobs WHERE id = ?1 AND tenant = ?2 AND status IN ('successful', 'failed', 'dismissed') \
                     AND NOT EXISTS (SELECT 1 FROM maps WHERE job_id = ?1)";
const REVISIONS: &str = "SELECT id, revision FROM jobs WHERE id IN (SELECT value FROM json_each(?))";

#[async_trait]
impl JobBoard for SqliteStore {
    async fn submit(&self, new: NewJob) -> Result<Submission, StoreError> {
        self.intake.submit(new).await
    }

    async fn job(&self, tenant: &str, id: &str) -> Result<Option<Job>, StoreError> {
        let mut query = QueryBuilder::<Sqlite>::new("SELECT ");
        query.push(JOB).push(" FROM jobs WHERE id = ").push_bind(id.to_owned());
        query.push(" AND tenant = ").push_bind(tenant.to_owned());
        query.build().fetch_optional(&self.readers).await?.as_ref().map(rows::job).transpose()
    }

    async fn jobs(&self, listing: &Listing) -> Result<Vec<Job>, StoreError> {
        let mut query = listed::page(&listed::JOBS, JOB, listing);
        query.build().fetch_all(&self.readers).await?.iter().map(rows::job).collect()
    }

    async fn request(&self, tenant: &str, id: &str) -> Result<Option<Vec<u8>>, StoreError> {
        Ok(sqlx::query_scalar(REQUEST).bind(id).bind(tenant).fetch_optional(&self.readers).await?)
    }

    async fn cancel(&self, tenant: &str, id: &str) -> Result<Cancellation, StoreError> {
        let mut tx = self.begin().await?;
        let dismissed = sqlx::query(DISMISS).bind(id).bind(tenant).execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(match (self.job(tenant, id).await?, dismissed) {
            (Some(job), true) => Cancellation::Dismissed(job),
            (Some(job), false) => Cancellation::AlreadyEnded(job),
            (None, _) => Cancellation::Unknown,
        })
    }

    async fn relabel_job(&self, tenant: &str, id: &str, change: &Relabelling) -> Result<Option<Job>, StoreError> {
        let mut tx = self.begin().await?;
        let labels = change.labels.as_ref().map(serde_json::to_string).transpose()?;
        let update = sqlx::query(RELABEL).bind(change.name.is_some()).bind(change.name.clone().flatten()).bind(labels);
        update.bind(id).bind(tenant).execute(&mut *tx).await?;
        tx.commit().await?;
        self.job(tenant, id).await
    }

    async fn remove_job(&self, tenant: &str, id: &str) -> Result<Removal, StoreError> {
        let mut tx = self.begin().await?;
        let keys = format!("DELETE FROM idempotency_keys WHERE job_id = (SELECT id {ENDED})");
        sqlx::query(AssertSqlSafe(keys)).bind(id).bind(tenant).execute(&mut *tx).await?;
        let jobs = format!("DELETE {ENDED}");
        let removed = sqlx::query(AssertSqlSafe(jobs)).bind(id).bind(tenant).execute(&mut *tx).await?.rows_affected();
        tx.commit().await?;
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
        Ok(sqlx::query_as(REVISIONS).bind(serde_json::to_string(ids)?).fetch_all(&self.readers).await?)
    }
}

/// Enters a job, within a transaction that is committed, or fails, as a whole.
pub(super) async fn enter(tx: &mut Transaction<'static, Sqlite>, new: &NewJob) -> Result<Submission, StoreError> {
    if let Some((key, body)) = &new.idempotency {
        let known: Option<(String, String)> =
            sqlx::query_as(KNOWN_KEY).bind(&new.tenant).bind(key).fetch_optional(&mut **tx).await?;
        if let Some((known_body, job_id)) = known {
            return Ok(match known_body == *body {
                true => Submission::Repeated(job_by_id(tx, &job_id).await?),
                false => Submission::KeyReused,
            });
        }
    }
    if let Some(what) = over(tx, &new.tenant, new.quota).await? {
        return Ok(Submission::OverQuota(what));
    }
    let id = Uuid::now_v7().to_string();
    let insert = sqlx::query(AssertSqlSafe(format!("{INSERT} RETURNING {JOB}"))).bind(&id).bind(&new.tenant);
    let insert = insert.bind(&new.name).bind(serde_json::to_string(&new.labels)?);
    let insert = insert.bind(serde_json::to_string(&new.progress)?).bind(&new.message);
    let insert = insert.bind(new.priority).bind(&new.retry_of).bind(&new.traceparent);
    // The sum of a time and nothing is nothing.
    let insert = insert.bind(new.deadline_seconds.map(|seconds| (seconds * 1000.0) as i64));
    // All rows, though there is one: only then is the statement at its end.
    let rows = insert.fetch_all(&mut **tx).await?;
    sqlx::query(KEEP_REQUEST).bind(&id).bind(&new.request[..]).execute(&mut **tx).await?;
    if let Some((key, body)) = &new.idempotency {
        sqlx::query(KEEP_KEY).bind(&new.tenant).bind(key).bind(body).bind(&id).execute(&mut **tx).await?;
    }
    let job = rows.first().map_or_else(|| Err(sqlx::Error::RowNotFound.into()), rows::job)?;
    Ok(Submission::Accepted(job))
}

/// What a tenant has as much of as it may.
async fn over(
    tx: &mut Transaction<'static, Sqlite>,
    tenant: &str,
    quota: Option<Quota>,
) -> Result<Option<&'static str>, StoreError> {
    let Some(quota) = quota else { return Ok(None) };
    let held: Option<(i64, i64)> = sqlx::query_as(HELD).bind(tenant).fetch_optional(&mut **tx).await?;
    let (queued, bytes) = held.unwrap_or_default();
    Ok(match (queued >= quota.queued, bytes >= quota.bytes) {
        (true, _) => Some("queued jobs"),
        (_, true) => Some("bytes of maps"),
        _ => None,
    })
}

async fn job_by_id(tx: &mut Transaction<'static, Sqlite>, id: &str) -> Result<Job, StoreError> {
    let mut query = QueryBuilder::<Sqlite>::new("SELECT ");
    query.push(JOB).push(" FROM jobs WHERE id = ").push_bind(id.to_owned());
    rows::job(&query.build().fetch_one(&mut **tx).await?)
}
