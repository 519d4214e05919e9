//! The records in SQLite: the default, one file under the data folder. A file for each port.
//!
//! WAL, `synchronous = FULL` (a commit is on disk before it returns), and one writer connection, so that writers queue
//! in the process instead of meeting `SQLITE_BUSY` in the database; a second process on the same file waits by
//! `busy_timeout`. Every write transaction is `BEGIN IMMEDIATE`: a transaction that begins as a reader and then writes
//! could meet `SQLITE_BUSY_SNAPSHOT`, which no timeout covers.

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

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use futures::FutureExt;
use futures::future::BoxFuture;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection, Sqlite, Transaction};

use self::intake::SqliteLedger;
use super::StoreError;
use super::intake::Intake;
use super::schema::{self, migrator};

/// Milliseconds since 1970 by the database's clock.
macro_rules! now {
    () => {
        "CAST(unixepoch('subsec') * 1000 AS INTEGER)"
    };
}
use now;

/// Under `migrations/sqlite`, from the first on.
pub(super) const MIGRATIONS: [schema::File; 7] = [
    (1, "jobs and maps", include_str!("../../../migrations/sqlite/0001_jobs_and_maps.sql")),
    (2, "queue and labels", include_str!("../../../migrations/sqlite/0002_queue_and_labels.sql")),
    (3, "fleet", include_str!("../../../migrations/sqlite/0003_fleet.sql")),
    (4, "sweeps", include_str!("../../../migrations/sqlite/0004_sweeps.sql")),
    (5, "traces", include_str!("../../../migrations/sqlite/0005_traces.sql")),
    (6, "parts", include_str!("../../../migrations/sqlite/0006_parts.sql")),
    (7, "rounds", include_str!("../../../migrations/sqlite/0007_rounds.sql")),
];

/// [`super::Records`] in one SQLite file.
pub struct SqliteStore {
    readers: SqlitePool,
    writer: SqlitePool,
    intake: Arc<Intake<SqliteLedger>>,
}

impl SqliteStore {
    /// Opens the file, or makes it, and brings its schema up to date.
    pub fn open(file: &Path) -> BoxFuture<'_, Result<Self, StoreError>> {
        // Boxed here, or whoever awaits it compiles the driver once more.
        Self::opened(file).boxed()
    }

    async fn opened(file: &Path) -> Result<Self, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(file)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(Duration::from_secs(10))
            .foreign_keys(true);
        // A connection whose transaction SQLite rolled back by itself (disk full) is not handed out again. None needs to be tried
        // before that: nothing is between it and its file.
        let pool = |size: u32| {
            let pool = SqlitePoolOptions::new().max_connections(size).acquire_timeout(Duration::from_secs(20));
            pool.test_before_acquire(false).after_release(|connection, _| {
                Box::pin(async move {
                    if connection.is_in_transaction() {
                        // Until what was left undone is undone.
                        connection.ping().await?;
                    }
                    Ok(!connection.is_in_transaction())
                })
            })
        };
        let writer = pool(1).connect_with(options.clone()).await?;
        migrator(&MIGRATIONS).run(&writer).await?;
        let readers = pool(4).connect_with(options).await?;
        Ok(Self { readers, intake: Intake::new(SqliteLedger(writer.clone())), writer })
    }

    async fn begin(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// A transaction that sees one moment. Nobody waits for it.
    async fn begin_reading(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.readers.begin().await?)
    }
}
