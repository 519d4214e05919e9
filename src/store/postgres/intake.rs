//! Groups of submissions: three statements for a group as for one job, of which the last commits by itself.
//!
//! Any number of processes submit at once. A key that another brought in this moment breaks the whole statement, and its
//! group is entered one by one ([`crate::store::intake`]); a single submission looks again. Rows go in by tenant and
//! priority, so that two groups never wait for each other's lanes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use async_trait::async_trait;
use sqlx::postgres::{PgConnection, PgPool, PgRow};
use sqlx::{AssertSqlSafe, Connection};
use tokio::sync::{Mutex, OwnedMutexGuard};

use super::rows::{self, JOB, LEASE};
use crate::jobs::Job;
use crate::store::intake::Ledger;
use crate::store::intake::group::{self, Group, Held, Known};
use crate::store::{NewJob, StoreError, Submission};

/// A quota is exact as long as no more submissions of a tenant than this are under way at once: so near to it they queue.
const MARGIN: i64 = 1024;
/// How often a submission looks again whether another brought its key first.
const TRIES: usize = 3;
/// A connection that was used so long ago is asked first whether it still is one.
const FRESH: Duration = Duration::from_secs(1);
/// And has so long to answer.
const ANSWERS_WITHIN: Duration = Duration::from_secs(1);

const KNOWN_KEYS: &str = "SELECT k.tenant, k.key, k.body, k.job_id FROM unnest($1::text[], $2::text[]) AS asked (tenant, key) \
     JOIN idempotency_keys AS k ON k.tenant = asked.tenant AND k.key = asked.key";
const HELD: &str =
    "SELECT tenant, sum(queued)::bigint, sum(bytes)::bigint FROM holdings WHERE tenant = ANY($1) GROUP BY tenant";
const QUOTA_LOCK: &str = "SELECT pg_advisory_xact_lock(key) FROM \
     (SELECT DISTINCT quota_key(tenant) AS key FROM unnest($1::text[]) AS tenant ORDER BY key) AS keys";
/// One statement, so that it commits by itself; a trigger tells who listens.
const INSERT: &str = "WITH clock AS MATERIALIZED (SELECT now_ms() AS at), \
     new AS MATERIALIZED (SELECT * FROM unnest($1::text[], $2::text[], $3::text[], $4::text[], $5::text[], $6::text[], \
             $7::int[], $8::text[], $9::bigint[], $10::text[], $11::bytea[], $12::text[], $13::text[]) \
         AS new (id, tenant, name, labels, progress, message, priority, retry_of, within, traceparent, request, key, body)), \
     keyed AS (INSERT INTO idempotency_keys (tenant, key, body, job_id) \
               SELECT tenant, key, body, id FROM new WHERE key IS NOT NULL ORDER BY tenant, key), \
     kept AS (INSERT INTO requests (job_id, request) SELECT id, request FROM new), \
     j AS (INSERT INTO jobs (id, tenant, name, labels, status, progress, message, priority, retry_of, deadline, \
                             traceparent, created, updated) \
           SELECT id, tenant, name, labels, 'accepted', progress, message, priority, retry_of, at + within, traceparent, at, at \
           FROM new, clock ORDER BY tenant, priority, id RETURNING *) SELECT ";

/// The database, as submissions see it.
pub(super) struct PostgresLedger {
    pool: PgPool,
    /// One group at a time from this process. Two would begin sooner and be smaller: one of ten costs the database little more
    /// than one of five.
    one: Arc<Mutex<Option<Kept>>>,
}

/// The connection of the last group. The pool asks every connection whether it lives, when it is given back and when it is
/// taken: one round trip in three of a busy intake, and between a group and the next. It is not the pool's any more, which
/// takes its own back only where a runtime is.
struct Kept {
    connection: PgConnection,
    used: Instant,
}

/// A connection, and the right to hold it.
pub(super) struct Turn {
    connection: PgConnection,
    /// Whether nobody has asked it whether it lives.
    is_kept: bool,
    one: OwnedMutexGuard<Option<Kept>>,
}

impl PostgresLedger {
    pub fn new(pool: PgPool) -> Self {
        Self { pool, one: Arc::default() }
    }
}

#[async_trait]
impl Ledger for PostgresLedger {
    type Turn = Turn;

    async fn turn(&self) -> Result<Turn, StoreError> {
        let mut one = self.one.clone().lock_owned().await;
        let mut kept = one.take();
        let is_kept = kept.as_ref().is_some_and(|kept| kept.used.elapsed() < FRESH);
        if let Some(old) = kept.as_mut().filter(|_| !is_kept)
            && !matches!(tokio::time::timeout(ANSWERS_WITHIN, old.connection.ping()).await, Ok(Ok(())))
        {
            kept = None;
        }
        let connection = match kept {
            Some(kept) => kept.connection,
            None => self.pool.acquire().await?.detach(),
        };
        Ok(Turn { connection, is_kept, one })
    }

    async fn enter(&self, mut turn: Turn, group: &[NewJob]) -> Result<Vec<Submission>, StoreError> {
        let mut tries = if group.len() == 1 { TRIES } else { 0 };
        let outcomes = loop {
            let seen = match look(&mut turn.connection, group).await {
                // It died since. Nothing was written yet: another will do.
                Err(_) if turn.is_kept => {
                    (turn.connection, turn.is_kept) = (self.pool.acquire().await?.detach(), false);
                    continue;
                }
                seen => seen?,
            };
            match enter(&mut turn.connection, group, seen).await {
                // Another submission brought the key between the look and the insert, and has committed.
                Err(StoreError::Database(error)) if tries > 0 && is_repeat(&error) => tries -= 1,
                outcome => break outcome?,
            }
        };
        *turn.one = Some(Kept { connection: turn.connection, used: Instant::now() });
        Ok(outcomes)
    }
}

/// What a group has to know before it is written: jobs of its keys, and what its tenants hold.
async fn look(connection: &mut PgConnection, group: &[NewJob]) -> Result<(Known, Held), StoreError> {
    Ok((known(connection, group).await?, held(connection, group).await?))
}

async fn enter(
    connection: &mut PgConnection,
    group: &[NewJob],
    (known, counted): (Known, Held),
) -> Result<Vec<Submission>, StoreError> {
    let near = near_their_quota(group, &counted);
    if near.is_empty() {
        return write(connection, Group::of(group, &known, counted)).await;
    }
    let mut tx = connection.begin().await?;
    sqlx::query(QUOTA_LOCK).bind(&near).execute(&mut *tx).await?;
    let counted = held(&mut tx, group).await?;
    let outcomes = write(&mut tx, Group::of(group, &known, counted)).await?;
    tx.commit().await?;
    Ok(outcomes)
}

async fn known(connection: &mut PgConnection, group: &[NewJob]) -> Result<Known, StoreError> {
    let (tenants, keys): (Vec<&str>, Vec<&str>) = group::keys(group).into_iter().unzip();
    let mut known = Known::new();
    if keys.is_empty() {
        return Ok(known);
    }
    let found: Vec<(String, String, String, String)> =
        sqlx::query_as(KNOWN_KEYS).bind(&tenants).bind(&keys).fetch_all(&mut *connection).await?;
    for (tenant, key, body, id) in found {
        let query = format!("SELECT {JOB} FROM jobs AS j{LEASE} WHERE j.id = $1");
        // A job that is removed in this moment takes its key with it.
        let job = sqlx::query(AssertSqlSafe(query)).bind(id).fetch_optional(&mut *connection).await?;
        if let Some(job) = job {
            known.insert((tenant, key), (body, rows::job(&job)?));
        }
    }
    Ok(known)
}

/// How many jobs of each tenant wait, and the bytes of its maps.
async fn held(connection: &mut PgConnection, group: &[NewJob]) -> Result<Held, StoreError> {
    let tenants = group::counted(group);
    if tenants.is_empty() {
        return Ok(Held::new());
    }
    let held: Vec<(String, i64, i64)> = sqlx::query_as(HELD).bind(&tenants).fetch_all(connection).await?;
    Ok(held.into_iter().map(|(tenant, queued, bytes)| (tenant, (queued, bytes))).collect())
}

/// Tenants whose submissions queue.
fn near_their_quota<'a>(group: &'a [NewJob], held: &Held) -> Vec<&'a str> {
    let near = |new: &&NewJob| {
        let queued = held.get(&new.tenant).map_or(0, |(queued, _)| *queued);
        new.quota.is_some_and(|quota| queued >= quota.queued.saturating_sub(MARGIN))
    };
    group.iter().filter(near).map(|new| &new.tenant[..]).collect()
}

async fn write(connection: &mut PgConnection, group: Group<'_>) -> Result<Vec<Submission>, StoreError> {
    if !group.has_new_jobs() {
        return group.written(Vec::new());
    }
    let mut labels = Vec::new();
    let mut progress = Vec::new();
    for (_, new) in group.new_jobs() {
        labels.push(serde_json::to_string(&new.labels)?);
        progress.push(serde_json::to_string(&new.progress)?);
    }
    let (ids, new): (Vec<&str>, Vec<&NewJob>) = group.new_jobs().unzip();
    let key = |new: &&NewJob| new.idempotency.as_ref().map(|(key, _)| key.clone());
    let body = |new: &&NewJob| new.idempotency.as_ref().map(|(_, body)| body.clone());
    let insert = sqlx::query(AssertSqlSafe(format!("{INSERT}{JOB} FROM j{LEASE}")));
    let insert = insert.bind(&ids).bind(column(&new, |new| new.tenant.clone()));
    let insert = insert.bind(column(&new, |new| new.name.clone())).bind(labels).bind(progress);
    let insert = insert.bind(column(&new, |new| new.message.clone())).bind(column(&new, |new| new.priority));
    let insert = insert.bind(column(&new, |new| new.retry_of.clone())).bind(column(&new, |new| new.deadline()));
    let insert = insert.bind(column(&new, |new| new.traceparent.clone())).bind(column(&new, |new| &new.request[..]));
    let insert = insert.bind(column(&new, key)).bind(column(&new, body));
    // All rows, though there may be one: only then is the commit known of.
    let rows: Vec<PgRow> = insert.fetch_all(connection).await?;
    let jobs = rows.iter().map(rows::job).collect::<Result<Vec<Job>, StoreError>>()?;
    group.written(jobs)
}

/// One value of each.
fn column<'a, T>(new: &[&'a NewJob], value: impl Fn(&&'a NewJob) -> T) -> Vec<T> {
    new.iter().map(value).collect()
}

/// Whether a key is there already.
fn is_repeat(error: &sqlx::Error) -> bool {
    error.as_database_error().is_some_and(|error| error.is_unique_violation())
}
