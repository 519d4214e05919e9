//! Groups of submissions on the one writer connection. A statement is a trip to the connection's thread and back, so there are as
//! many of them for a group as for one job.

use async_trait::async_trait;
use sqlx::sqlite::{SqlitePool, SqliteRow};
use sqlx::{QueryBuilder, Sqlite, Transaction};

use super::now;
use super::rows::{self, JOB};
use crate::jobs::Job;
use crate::store::intake::Ledger;
use crate::store::intake::group::{self, Group, Held, Known};
use crate::store::{NewJob, StoreError, Submission};

const KNOWN_KEYS: &str = "SELECT k.tenant, k.key, k.body, k.job_id FROM json_each(?) AS asked \
                          CROSS JOIN idempotency_keys AS k ON k.tenant = asked.value ->> 0 AND k.key = asked.value ->> 1";
const HELD: &str = "SELECT tenant, queued, bytes FROM holdings WHERE tenant IN (SELECT value FROM json_each(?))";
const INSERT: &str = "INSERT INTO jobs (id, tenant, name, labels, status, progress, message, priority, retry_of, \
                      traceparent, deadline, created, updated) ";
const KEEP_REQUESTS: &str = "INSERT INTO requests (job_id, request) ";
const KEEP_KEYS: &str = "INSERT INTO idempotency_keys (tenant, key, body, job_id) ";

type Transacted = Transaction<'static, Sqlite>;

/// The writer, as submissions see it.
pub(super) struct SqliteLedger(pub SqlitePool);

#[async_trait]
impl Ledger for SqliteLedger {
    type Turn = Transacted;

    async fn turn(&self) -> Result<Transacted, StoreError> {
        Ok(self.0.begin_with("BEGIN IMMEDIATE").await?)
    }

    async fn enter(&self, mut tx: Transacted, group: &[NewJob]) -> Result<Vec<Submission>, StoreError> {
        let known = known(&mut tx, group).await?;
        let held = held(&mut tx, group).await?;
        let group = Group::of(group, &known, held);
        let jobs = if group.has_new_jobs() { write(&mut tx, &group).await? } else { Vec::new() };
        tx.commit().await?;
        group.written(jobs)
    }
}

async fn known(tx: &mut Transacted, group: &[NewJob]) -> Result<Known, StoreError> {
    let asked = group::keys(group);
    let mut known = Known::new();
    if asked.is_empty() {
        return Ok(known);
    }
    let keys: Vec<(String, String, String, String)> =
        sqlx::query_as(KNOWN_KEYS).bind(serde_json::to_string(&asked)?).fetch_all(&mut **tx).await?;
    for (tenant, key, body, id) in keys {
        let mut query = QueryBuilder::<Sqlite>::new("SELECT ");
        query.push(JOB).push(" FROM jobs WHERE id = ").push_bind(id);
        let job = rows::job(&query.build().fetch_one(&mut **tx).await?)?;
        known.insert((tenant, key), (body, job));
    }
    Ok(known)
}

async fn held(tx: &mut Transacted, group: &[NewJob]) -> Result<Held, StoreError> {
    let tenants = group::counted(group);
    if tenants.is_empty() {
        return Ok(Held::new());
    }
    let held: Vec<(String, i64, i64)> =
        sqlx::query_as(HELD).bind(serde_json::to_string(&tenants)?).fetch_all(&mut **tx).await?;
    Ok(held.into_iter().map(|(tenant, queued, bytes)| (tenant, (queued, bytes))).collect())
}

async fn write(tx: &mut Transacted, group: &Group<'_>) -> Result<Vec<Job>, StoreError> {
    let mut rows = Vec::new();
    for (id, new) in group.new_jobs() {
        rows.push((id, new, serde_json::to_string(&new.labels)?, serde_json::to_string(&new.progress)?));
    }
    let mut insert = QueryBuilder::<Sqlite>::new(INSERT);
    insert.push_values(rows, |mut row, (id, new, labels, progress)| {
        row.push_bind(id).push_bind(&new.tenant).push_bind(&new.name).push_bind(labels).push("'accepted'");
        row.push_bind(progress).push_bind(&new.message).push_bind(new.priority).push_bind(&new.retry_of);
        row.push_bind(&new.traceparent).push(concat!(now!(), " + ")).push_bind_unseparated(new.deadline());
        row.push(now!()).push(now!());
    });
    insert.push(" RETURNING ").push(JOB);
    let jobs: Vec<SqliteRow> = insert.build().fetch_all(&mut **tx).await?;
    let mut requests = QueryBuilder::<Sqlite>::new(KEEP_REQUESTS);
    requests.push_values(group.new_jobs(), |mut row, (id, new)| {
        row.push_bind(id).push_bind(&new.request[..]);
    });
    requests.build().execute(&mut **tx).await?;
    let keyed: Vec<_> =
        group.new_jobs().filter_map(|(id, new)| Some((id, &new.tenant, new.idempotency.as_ref()?))).collect();
    if !keyed.is_empty() {
        let mut keys = QueryBuilder::<Sqlite>::new(KEEP_KEYS);
        keys.push_values(keyed, |mut row, (id, tenant, (key, body))| {
            row.push_bind(tenant).push_bind(key).push_bind(body).push_bind(id);
        });
        keys.build().execute(&mut **tx).await?;
    }
    jobs.iter().map(rows::job).collect()
}
