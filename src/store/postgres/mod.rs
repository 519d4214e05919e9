//! The records in PostgreSQL: any number of servers and workers on one database. A file for each port.
//!
//! Read committed, and wherever it can be one statement for one write: it commits by itself, so a process that is stopped
//! in the middle holds no lock. What a statement has to keep true beside its row (lanes, leases, holdings, labels,
//! deliveries) triggers keep: see the migration, which also says in which order locks are taken.

mod backup;
mod board;
mod housekeeping;
mod intake;
mod keys;
mod leases;
mod listed;
mod parts;
mod places;
mod rows;
mod shelf;
mod webhooks;

use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use futures::FutureExt;
use futures::future::BoxFuture;
use sqlx::postgres::{PgConnectOptions, PgListener, PgPool, PgPoolOptions};
use sqlx::{Postgres, Transaction};
use tokio::sync::Notify;

use self::intake::PostgresLedger;
use super::StoreError;
use super::intake::Intake;
use super::schema::{self, migrator};

/// Milliseconds since 1970 by the database's clock, once a statement: so that an index can be searched for it.
macro_rules! now {
    () => {
        "(SELECT now_ms())"
    };
}
use now;

/// What submissions notify of, and publications.
const ARRIVALS: &str = "mapfit_jobs";
const PUBLICATIONS: &str = "mapfit_places";
/// How long to wait before listening again where the database is away.
const LISTEN_AGAIN: Duration = Duration::from_secs(1);
/// What every connection is opened with. All queries are made for an index, also while the statistics know of no rows yet;
/// a client that vanishes, or stops in the middle of a transaction, does not keep its locks.
const SETTINGS: [(&str, &str); 8] = [
    ("default_transaction_isolation", "read committed"),
    ("statement_timeout", "30s"),
    ("lock_timeout", "10s"),
    ("idle_in_transaction_session_timeout", "5s"),
    ("client_connection_check_interval", "10s"),
    ("tcp_keepalives_idle", "30"),
    ("enable_seqscan", "off"),
    ("jit", "off"),
];

/// Under `migrations/postgres`, from the first on.
pub(super) const MIGRATIONS: [schema::File; 7] = [
    (1, "records", include_str!("../../../migrations/postgres/0001_records.sql")),
    (2, "lists and sweeps", include_str!("../../../migrations/postgres/0002_lists_and_sweeps.sql")),
    (3, "traces", include_str!("../../../migrations/postgres/0003_traces.sql")),
    (4, "groups", include_str!("../../../migrations/postgres/0004_groups.sql")),
    (5, "parts", include_str!("../../../migrations/postgres/0005_parts.sql")),
    (6, "rounds", include_str!("../../../migrations/postgres/0006_rounds.sql")),
    (7, "releases", include_str!("../../../migrations/postgres/0007_releases.sql")),
];

/// [`super::Records`] in a PostgreSQL database.
pub struct PostgresStore {
    pool: PgPool,
    intake: Arc<Intake<PostgresLedger>>,
}

impl PostgresStore {
    /// Connects to the database, which has to be there, and brings its schema up to date.
    pub fn open(url: &str, max_connections: u32) -> BoxFuture<'_, Result<Self, StoreError>> {
        // Boxed here, or whoever awaits it compiles the driver once more.
        Self::opened(url, max_connections).boxed()
    }

    async fn opened(url: &str, max_connections: u32) -> Result<Self, StoreError> {
        let plain = PgConnectOptions::from_str(url)?.application_name("mapfit");
        // Processes that start at once wait here for the first, however long it takes.
        let once = PgPoolOptions::new().max_connections(1).connect_with(plain.clone()).await?;
        migrator(&MIGRATIONS).run(&once).await?;
        once.close().await;
        let pool = PgPoolOptions::new().max_connections(max_connections).acquire_timeout(Duration::from_secs(20));
        let pool = pool.connect_with(plain.options(SETTINGS)).await?;
        Ok(Self { intake: Intake::new(PostgresLedger::new(pool.clone())), pool })
    }

    /// Wakes one who waits for jobs whenever any process accepted one, and all who wait for places whenever any
    /// published at one, for as long as it is polled. What was notified while the database was away is lost: everyone
    /// is woken then.
    pub async fn listen(&self, arrivals: Arc<Notify>, publications: Arc<Notify>) {
        loop {
            if let Err(error) = self.hear(&arrivals, &publications).await {
                tracing::warn!(%error, "jobs and publications cannot be listened for; they are polled for");
            }
            tokio::time::sleep(LISTEN_AGAIN).await;
        }
    }

    async fn hear(&self, arrivals: &Notify, publications: &Notify) -> Result<(), StoreError> {
        // Not of the pool's connections, which others wait for.
        let options = self.pool.connect_options();
        let pool = PgPoolOptions::new().max_connections(1).idle_timeout(None).max_lifetime(None);
        let pool = pool.connect_with((*options).clone()).await?;
        let mut listener = PgListener::connect_with(&pool).await?;
        listener.listen_all([ARRIVALS, PUBLICATIONS]).await?;
        let all = || {
            arrivals.notify_waiters();
            publications.notify_waiters();
        };
        all();
        loop {
            match listener.try_recv().await? {
                Some(told) if told.channel() == PUBLICATIONS => publications.notify_waiters(),
                Some(_) => arrivals.notify_one(),
                None => all(),
            }
        }
    }

    async fn begin(&self) -> Result<Transaction<'static, Postgres>, StoreError> {
        Ok(self.pool.begin().await?)
    }

    /// A transaction that sees one moment. Nobody waits for it.
    async fn begin_reading(&self) -> Result<Transaction<'static, Postgres>, StoreError> {
        Ok(self.pool.begin_with("BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY").await?)
    }
}
