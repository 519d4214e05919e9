//! Jobs as clients see them.

use async_trait::async_trait;
use sqlx::{AssertSqlSafe, QueryBuilder, Sqlite};

use super::rows::{self, JOB};
use super::{SqliteStore, listed, now};
use crate::jobs::{Job, JobStatus};
use crate::store::{Cancellation, JobBoard, Listing, NewJob, Relabelling, Removal, StoreError, Submission};

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
