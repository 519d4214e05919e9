//! The records in SQLite: the default, one file under the data folder.
//!
//! WAL, `synchronous = FULL` (a commit is on disk before it returns), and one writer connection, so that writers queue
//! in the process instead of meeting `SQLITE_BUSY` in the database; a second process on the same file waits by
//! `busy_timeout`. Every write transaction is `BEGIN IMMEDIATE`: a transaction that begins as a reader and then writes
//! could meet `SQLITE_BUSY_SNAPSHOT`, which no timeout covers.

use std::path::Path;
use std::time::Duration;

use async_trait::async_trait;
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteRow, SqliteSynchronous,
};
use sqlx::{AssertSqlSafe, Connection, QueryBuilder, Row, Sqlite, Transaction};
use uuid::Uuid;

use super::listed;
use super::{Cancellation, Claim, JobStore, LEASE, Listing, MAX_ATTEMPTS, NewJob, Removal, StoreError, Submission};
use crate::fit::Distance;
use crate::jobs::{Job, JobStatus, MapRecord, ProblemReport, Progress};

/// Milliseconds since 1970 by the database's clock.
const NOW: &str = "CAST(unixepoch('subsec') * 1000 AS INTEGER)";
/// The progress of a job that goes back to the queue.
const QUEUED_AGAIN: &str =
    "progress = json_set(progress, '$.percent', 0.0, '$.stage', 'queued', '$.iteration', 0, '$.objective', NULL)";
const JOB: &str = "id, tenant, name, labels, status, progress, message, problem, created, started, finished, updated, \
                   attempt, priority, map_id, revision";

/// Retried jobs that a claim puts back in the queue at most.
const MOST_DUE: i64 = 32;

/// A [`JobStore`] in one SQLite file.
pub struct SqliteStore {
    readers: SqlitePool,
    writer: SqlitePool,
}

impl SqliteStore {
    /// Opens the file, or makes it, and brings its schema up to date.
    pub async fn open(file: &Path) -> Result<Self, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(file)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(Duration::from_secs(10))
            .foreign_keys(true);
        // A connection whose transaction SQLite rolled back by itself (disk full) is not handed out again.
        let pool = |size: u32| {
            SqlitePoolOptions::new().max_connections(size).acquire_timeout(Duration::from_secs(20)).after_release(
                |connection, _| {
                    Box::pin(async move {
                        connection.ping().await?;
                        Ok(!connection.is_in_transaction())
                    })
                },
            )
        };
        let writer = pool(1).connect_with(options.clone()).await?;
        sqlx::migrate!("migrations/sqlite").run(&writer).await?;
        let readers = pool(4).connect_with(options).await?;
        Ok(Self { readers, writer })
    }

    async fn begin(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// A fenced update: `assignments` on the running attempt, `false` where the lease is lost.
    async fn fenced(
        &self,
        id: &str,
        attempt: i64,
        assignments: impl FnOnce(&mut QueryBuilder<Sqlite>),
    ) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let mut update = QueryBuilder::<Sqlite>::new("UPDATE jobs SET revision = revision + 1, updated = ");
        update.push(NOW).push(", ");
        assignments(&mut update);
        update.push(" WHERE id = ").push_bind(id.to_owned()).push(" AND attempt = ").push_bind(attempt);
        update.push(" AND status = 'running'");
        let held = update.build().execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(held)
    }
}

#[async_trait]
impl JobStore for SqliteStore {
    async fn submit(&self, new: NewJob) -> Result<Submission, StoreError> {
        let mut tx = self.begin().await?;
        if let Some((key, body)) = &new.idempotency {
            let known: Option<(String, String)> =
                sqlx::query_as("SELECT body, job_id FROM idempotency_keys WHERE tenant = ? AND key = ?")
                    .bind(&new.tenant)
                    .bind(key)
                    .fetch_optional(&mut *tx)
                    .await?;
            if let Some((known_body, job_id)) = known {
                if known_body != *body {
                    return Ok(Submission::KeyReused);
                }
                let job = job_by_id(&mut tx, &job_id).await?;
                return Ok(Submission::Repeated(job));
            }
        }
        let id = Uuid::now_v7().to_string();
        let mut insert = QueryBuilder::<Sqlite>::new(
            "INSERT INTO jobs (id, tenant, name, labels, status, progress, message, priority, created, updated) \
             VALUES (",
        );
        let mut values = insert.separated(", ");
        values.push_bind(&id).push_bind(&new.tenant).push_bind(&new.name);
        values.push_bind(serde_json::to_string(&new.labels)?).push_bind("accepted");
        values.push_bind(serde_json::to_string(&new.progress)?).push_bind(&new.message).push_bind(new.priority);
        values.push(NOW).push(NOW);
        insert.push(")").build().execute(&mut *tx).await?;
        sqlx::query("INSERT INTO requests (job_id, request) VALUES (?, ?)")
            .bind(&id)
            .bind(new.request)
            .execute(&mut *tx)
            .await?;
        if let Some((key, body)) = &new.idempotency {
            sqlx::query("INSERT INTO idempotency_keys (tenant, key, body, job_id) VALUES (?, ?, ?, ?)")
                .bind(&new.tenant)
                .bind(key)
                .bind(body)
                .bind(&id)
                .execute(&mut *tx)
                .await?;
        }
        let job = job_by_id(&mut tx, &id).await?;
        tx.commit().await?;
        Ok(Submission::Accepted(job))
    }

    async fn job(&self, tenant: &str, id: &str) -> Result<Option<Job>, StoreError> {
        let mut query = QueryBuilder::<Sqlite>::new("SELECT ");
        query.push(JOB).push(" FROM jobs WHERE id = ").push_bind(id.to_owned());
        query.push(" AND tenant = ").push_bind(tenant.to_owned());
        query.build().fetch_optional(&self.readers).await?.as_ref().map(read_job).transpose()
    }

    async fn jobs(&self, listing: &Listing) -> Result<Vec<Job>, StoreError> {
        let mut query = listed::page(&listed::JOBS, JOB, listing);
        query.build().fetch_all(&self.readers).await?.iter().map(read_job).collect()
    }

    async fn request(&self, tenant: &str, id: &str) -> Result<Option<Vec<u8>>, StoreError> {
        const REQUEST: &str = "SELECT requests.request FROM jobs JOIN requests ON requests.job_id = jobs.id \
             WHERE jobs.id = ? AND jobs.tenant = ?";
        Ok(sqlx::query_scalar(REQUEST).bind(id).bind(tenant).fetch_optional(&self.readers).await?)
    }

    async fn cancel(&self, tenant: &str, id: &str) -> Result<Cancellation, StoreError> {
        let mut tx = self.begin().await?;
        let mut update = QueryBuilder::<Sqlite>::new("UPDATE jobs SET status = 'dismissed', revision = revision + 1");
        update.push(", lease_until = NULL, finished = ").push(NOW).push(", updated = ").push(NOW);
        update.push(" WHERE id = ").push_bind(id.to_owned()).push(" AND tenant = ").push_bind(tenant.to_owned());
        update.push(" AND status IN ('accepted', 'running')");
        let dismissed = update.build().execute(&mut *tx).await?.rows_affected() == 1;
        tx.commit().await?;
        Ok(match (self.job(tenant, id).await?, dismissed) {
            (Some(job), true) => Cancellation::Dismissed(job),
            (Some(job), false) => Cancellation::AlreadyEnded(job),
            (None, _) => Cancellation::Unknown,
        })
    }

    async fn remove_job(&self, tenant: &str, id: &str) -> Result<Removal, StoreError> {
        const ENDED: &str = "FROM jobs WHERE id = ?1 AND tenant = ?2 AND status IN ('successful', 'failed', 'dismissed') \
             AND NOT EXISTS (SELECT 1 FROM maps WHERE job_id = ?1)";
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
            Some(Job { status, map_id: Some(map), .. }) if status.has_ended() => Removal::HasMap(map),
            Some(_) => Removal::NotEnded,
        })
    }

    async fn revisions(&self, ids: &[String]) -> Result<Vec<(String, i64)>, StoreError> {
        let query = "SELECT id, revision FROM jobs WHERE id IN (SELECT value FROM json_each(?))";
        Ok(sqlx::query_as(query).bind(serde_json::to_string(ids)?).fetch_all(&self.readers).await?)
    }

    async fn claim(&self, worker: &str) -> Result<Option<Claim>, StoreError> {
        let mut tx = self.begin().await?;
        // Retried jobs whose time has come join the queue; see the migration.
        let mut due = QueryBuilder::<Sqlite>::new("UPDATE jobs SET not_before = 0 WHERE id IN (SELECT id FROM jobs");
        due.push(" WHERE status = 'accepted' AND not_before > 0 AND not_before <= ").push(NOW);
        due.push(" ORDER BY not_before LIMIT ").push_bind(MOST_DUE).push(")");
        due.build().execute(&mut *tx).await?;
        let mut update = QueryBuilder::<Sqlite>::new("UPDATE jobs SET status = 'running', attempt = attempt + 1");
        update.push(", revision = revision + 1, worker = ").push_bind(worker.to_owned());
        update.push(", lease_until = ").push(NOW).push(" + ").push_bind(LEASE.as_millis() as i64);
        update.push(", updated = ").push(NOW).push(", started = COALESCE(started, ").push(NOW).push(") WHERE id = (");
        update.push("SELECT id FROM turns ORDER BY priority DESC, running, created, id LIMIT 1) RETURNING ").push(JOB);
        let row = update.build().fetch_all(&mut *tx).await?.into_iter().next();
        let job = row.as_ref().map(read_job).transpose()?;
        let claim = match job {
            Some(job) => {
                let request = sqlx::query_scalar("SELECT request FROM requests WHERE job_id = ?")
                    .bind(&job.id)
                    .fetch_one(&mut *tx)
                    .await?;
                Some(Claim { job, request })
            }
            None => None,
        };
        tx.commit().await?;
        Ok(claim)
    }

    async fn reap(&self) -> Result<u64, StoreError> {
        let exhausted = ProblemReport {
            r#type: "/problems/attempts-exhausted".into(),
            title: "The job's worker died too often".into(),
            status: 500,
            detail: format!(
                "the job was begun {MAX_ATTEMPTS} times and no worker finished it; it will not be run again"
            ),
        };
        let mut tx = self.begin().await?;
        let mut fail = QueryBuilder::<Sqlite>::new("UPDATE jobs SET status = 'failed', revision = revision + 1");
        fail.push(", lease_until = NULL, problem = ").push_bind(serde_json::to_string(&exhausted)?);
        fail.push(", finished = ").push(NOW).push(", updated = ").push(NOW);
        fail.push(" WHERE status = 'running' AND lease_until < ").push(NOW);
        fail.push(" AND attempt >= ").push_bind(MAX_ATTEMPTS);
        let failed = fail.build().execute(&mut *tx).await?.rows_affected();
        let mut requeue = QueryBuilder::<Sqlite>::new("UPDATE jobs SET status = 'accepted', revision = revision + 1");
        requeue
            .push(", lease_until = NULL, message = 'its worker was lost; it runs again', ")
            .push(QUEUED_AGAIN)
            .push(", updated = ")
            .push(NOW);
        requeue.push(" WHERE status = 'running' AND lease_until < ").push(NOW);
        let requeued = requeue.build().execute(&mut *tx).await?.rows_affected();
        tx.commit().await?;
        Ok(failed + requeued)
    }

    async fn heartbeat(&self, id: &str, attempt: i64, progress: &Progress) -> Result<bool, StoreError> {
        let progress = serde_json::to_string(progress)?;
        self.fenced(id, attempt, |update| {
            update.push("progress = ").push_bind(progress);
            update.push(", lease_until = ").push(NOW).push(" + ").push_bind(LEASE.as_millis() as i64);
        })
        .await
    }

    async fn succeed(&self, attempt: i64, map: &MapRecord) -> Result<bool, StoreError> {
        let done = Progress {
            percent: 100.0,
            stage: "done".into(),
            iteration: map.fit.iterations,
            max_iterations: map.fit.iterations,
            objective: Some(map.fit.objective),
        };
        let mut tx = self.begin().await?;
        let mut update = QueryBuilder::<Sqlite>::new("UPDATE jobs SET status = 'successful', revision = revision + 1");
        update.push(", lease_until = NULL, map_id = ").push_bind(&map.id);
        // The largest number of steps is the request's; it stays as it is.
        update.push(", progress = json_set(").push_bind(serde_json::to_string(&done)?);
        update.push(", '$.max_iterations', json_extract(progress, '$.max_iterations'))");
        update.push(", finished = ").push(NOW).push(", updated = ").push(NOW);
        update.push(" WHERE id = ").push_bind(&map.job_id).push(" AND attempt = ").push_bind(attempt);
        update.push(" AND status = 'running'");
        if update.build().execute(&mut *tx).await?.rows_affected() != 1 {
            return Ok(false);
        }
        let bounds = map.lattice.bounds();
        let mut insert = QueryBuilder::<Sqlite>::new(
            "INSERT INTO maps (id, job_id, tenant, name, labels, distance, lattice, fit, min_x, min_y, max_x, max_y, \
             prefix, created) VALUES (",
        );
        let mut values = insert.separated(", ");
        values.push_bind(&map.id).push_bind(&map.job_id).push_bind(&map.tenant).push_bind(&map.name);
        values.push_bind(serde_json::to_string(&map.labels)?).push_bind(map.distance.name());
        values.push_bind(serde_json::to_string(&map.lattice)?).push_bind(serde_json::to_string(&map.fit)?);
        values.push_bind(bounds.min[0]).push_bind(bounds.min[1]).push_bind(bounds.max[0]).push_bind(bounds.max[1]);
        values.push_bind(&map.prefix).push(NOW);
        insert.push(")").build().execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(true)
    }

    async fn fail(&self, id: &str, attempt: i64, problem: &ProblemReport) -> Result<bool, StoreError> {
        let problem = serde_json::to_string(problem)?;
        self.fenced(id, attempt, |update| {
            update.push("status = 'failed', lease_until = NULL, problem = ").push_bind(problem);
            update.push(", finished = ").push(NOW);
        })
        .await
    }

    async fn retry(&self, id: &str, attempt: i64, delay: Duration, why: &str) -> Result<bool, StoreError> {
        let why = format!("attempt {attempt} did not finish, it runs again: {why}");
        self.fenced(id, attempt, |update| {
            update
                .push("status = 'accepted', lease_until = NULL, ")
                .push(QUEUED_AGAIN)
                .push(", message = ")
                .push_bind(why);
            update.push(", not_before = ").push(NOW).push(" + ").push_bind(delay.as_millis() as i64);
        })
        .await
    }

    async fn release(&self, id: &str, attempt: i64) -> Result<bool, StoreError> {
        self.fenced(id, attempt, |update| {
            update.push("status = 'accepted', lease_until = NULL, attempt = attempt - 1, ").push(QUEUED_AGAIN);
        })
        .await
    }

    async fn map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError> {
        sqlx::query("SELECT * FROM maps WHERE id = ? AND tenant = ?")
            .bind(id)
            .bind(tenant)
            .fetch_optional(&self.readers)
            .await?
            .as_ref()
            .map(read_map)
            .transpose()
    }

    async fn maps(&self, listing: &Listing) -> Result<Vec<MapRecord>, StoreError> {
        let mut query = listed::page(&listed::MAPS, "*", listing);
        query.build().fetch_all(&self.readers).await?.iter().map(read_map).collect()
    }

    async fn delete_map(&self, tenant: &str, id: &str) -> Result<Option<MapRecord>, StoreError> {
        let mut tx = self.begin().await?;
        let rows = sqlx::query("DELETE FROM maps WHERE id = ? AND tenant = ? RETURNING *")
            .bind(id)
            .bind(tenant)
            .fetch_all(&mut *tx)
            .await?;
        tx.commit().await?;
        rows.first().map(read_map).transpose()
    }

    async fn owns_prefix(&self, prefix: &str, job_id: &str, attempt: i64) -> Result<bool, StoreError> {
        let owners: i64 = sqlx::query_scalar(
            "SELECT (SELECT count(*) FROM maps WHERE prefix = ?) \
             + (SELECT count(*) FROM jobs WHERE id = ? AND attempt = ? AND status = 'running')",
        )
        .bind(prefix)
        .bind(job_id)
        .bind(attempt)
        .fetch_one(&self.readers)
        .await?;
        Ok(owners > 0)
    }

    async fn probe(&self) -> Result<(), StoreError> {
        sqlx::query("SELECT (SELECT id FROM turns LIMIT 1), (SELECT max(id) FROM jobs), (SELECT max(id) FROM maps)")
            .fetch_one(&self.readers)
            .await?;
        let mut tx = self.begin().await?;
        let mut write = QueryBuilder::<Sqlite>::new("INSERT INTO probes (id, written) VALUES (1, ");
        write.push(NOW).push(") ON CONFLICT (id) DO UPDATE SET written = excluded.written");
        write.build().execute(&mut *tx).await?;
        Ok(tx.commit().await?)
    }
}

async fn job_by_id(tx: &mut Transaction<'static, Sqlite>, id: &str) -> Result<Job, StoreError> {
    let mut query = QueryBuilder::<Sqlite>::new("SELECT ");
    query.push(JOB).push(" FROM jobs WHERE id = ").push_bind(id.to_owned());
    read_job(&query.build().fetch_one(&mut **tx).await?)
}

fn read_job(row: &SqliteRow) -> Result<Job, StoreError> {
    let status: String = row.try_get("status")?;
    let problem: Option<String> = row.try_get("problem")?;
    Ok(Job {
        id: row.try_get("id")?,
        tenant: row.try_get("tenant")?,
        name: row.try_get("name")?,
        labels: serde_json::from_str(row.try_get("labels")?)?,
        status: JobStatus::from_name(&status).ok_or(StoreError::Status(status))?,
        progress: serde_json::from_str(row.try_get("progress")?)?,
        message: row.try_get("message")?,
        created: row.try_get("created")?,
        started: row.try_get("started")?,
        finished: row.try_get("finished")?,
        updated: row.try_get("updated")?,
        attempt: row.try_get("attempt")?,
        priority: row.try_get::<i64, _>("priority")? as i32,
        map_id: row.try_get("map_id")?,
        problem: problem.as_deref().map(serde_json::from_str).transpose()?,
        revision: row.try_get("revision")?,
    })
}

fn read_map(row: &SqliteRow) -> Result<MapRecord, StoreError> {
    Ok(MapRecord {
        id: row.try_get("id")?,
        job_id: row.try_get("job_id")?,
        tenant: row.try_get("tenant")?,
        name: row.try_get("name")?,
        labels: serde_json::from_str(row.try_get("labels")?)?,
        created: row.try_get("created")?,
        distance: distance(row.try_get("distance")?)?,
        lattice: serde_json::from_str(row.try_get("lattice")?)?,
        fit: serde_json::from_str(row.try_get("fit")?)?,
        prefix: row.try_get("prefix")?,
    })
}

fn distance(name: &str) -> Result<Distance, StoreError> {
    let known = Distance::ALL.into_iter().find(|distance| distance.name() == name);
    known.ok_or_else(|| StoreError::Distance(name.to_owned()))
}
