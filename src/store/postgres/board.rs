//! Jobs as clients see them.

use async_trait::async_trait;
use sqlx::AssertSqlSafe;

use super::rows::{self, JOB, LEASE};
use super::{PostgresStore, listed, now};
use crate::jobs::{Job, JobStatus};
use crate::store::{Cancellation, JobBoard, Listing, NewJob, Relabelling, Removal, StoreError, Submission};

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
        self.intake.submit(new).await
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
