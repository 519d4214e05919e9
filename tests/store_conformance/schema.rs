//! Databases of other versions: older ones are brought up to date with what is in them, newer ones are worked with as
//! they are.

use std::path::Path;
use std::time::Duration;

use mapfit::jobs::JobStatus;
use mapfit::spline::Lattice;
use mapfit::store::{Housekeeping, JobBoard, Leases, Listing, MapShelf, Places, PostgresStore, Records, SqliteStore};
use sqlx::migrate::Migrator;
use sqlx::sqlite::SqliteConnection;
use sqlx::{AssertSqlSafe, Connection, Executor, PgConnection};

use crate::postgres_server::database;
use crate::{DONE, LEASE, Progress, accept, listing, map_of, new_job, report, terms};

/// The first migrations of a folder, as sqlx reads them: the store has its files compiled in, and takes up what these began.
async fn first_of(count: usize, folder: &str) -> Migrator {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("migrations").join(folder);
    let mut migrations = Migrator::new(folder).await.unwrap();
    let first: Vec<_> = migrations.migrations.iter().take(count).cloned().collect();
    migrations.migrations = first.into();
    migrations
}

fn in_runtime(test: impl Future<Output = ()>) {
    tokio::runtime::Runtime::new().unwrap().block_on(test);
}

fn address(file: &Path) -> String {
    format!("sqlite://{}?mode=rwc", file.display())
}

/// A database as version 0.2.0 left it: its jobs are claimed, listed by label and asked for their requests as before.
#[test]
fn a_database_of_the_first_schema_is_brought_up_to_date() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("jobs.sqlite");
    in_runtime(async {
        let mut old = SqliteConnection::connect(&address(&file)).await.unwrap();
        first_of(1, "sqlite").await.run(&mut old).await.unwrap();
        for (k, status) in ["accepted", "running", "failed", "accepted"].iter().enumerate() {
            let progress = serde_json::to_string(&Progress::queued(9)).unwrap();
            sqlx::query(
                "INSERT INTO jobs (id, tenant, labels, status, progress, created, updated, request) VALUES (?, 'a', ?, ?, ?, ?, 0, ?)",
            )
            .bind(format!("0190000{k}-0000-7000-8000-000000000000"))
            .bind(format!("{{\"k\": \"{}\"}}", k % 2))
            .bind(*status)
            .bind(progress)
            .bind(k as i64)
            .bind(vec![k as u8; 3])
            .execute(&mut old)
            .await
            .unwrap();
        }
        old.close().await.unwrap();
        let store = SqliteStore::open(&file).await.unwrap();
        let odd = Listing { labels: vec![("k".into(), "1".into())], ..listing("a") };
        let ids: Vec<String> = store.jobs(&odd).await.unwrap().into_iter().map(|job| job.id[..8].to_owned()).collect();
        assert_eq!(ids, ["01900003", "01900001"]);
        let claim = store.claim(&terms("w")).await.unwrap().unwrap();
        assert_eq!((&claim.job.id[..8], claim.request), ("01900000", vec![0u8; 3]));
        assert_eq!(store.claim(&terms("w")).await.unwrap().unwrap().request, vec![3u8; 3]);
        assert!(store.claim(&terms("w")).await.unwrap().is_none());
    });
}

/// PostgreSQL's first schema, at work: a job that ended in a map at a place, one that runs under a lease, two that wait.
#[test]
fn a_postgres_database_of_the_first_schema_is_brought_up_to_date() {
    in_runtime(async {
        let url = database();
        let mut old = PgConnection::connect(&url).await.unwrap();
        first_of(1, "postgres").await.run(&mut old).await.unwrap();
        let progress = serde_json::to_string(&Progress::queued(9)).unwrap();
        for (id, created) in [("done", 1), ("runs", 2), ("waits", 3), ("waits-too", 4)] {
            let job = sqlx::query(
                "INSERT INTO jobs (id, tenant, labels, status, progress, created, updated) \
                 VALUES ($1, 'a', '{\"site\": \"hq\"}', 'accepted', $2, $3, $3)",
            );
            job.bind(id).bind(&progress).bind(created).execute(&mut old).await.unwrap();
            let request = sqlx::query("INSERT INTO requests (job_id, request) VALUES ($1, $2)");
            request.bind(id).bind(id.as_bytes()).execute(&mut old).await.unwrap();
        }
        for expected in ["done", "runs"] {
            let claim = "SELECT (claimed).id FROM claim_job('of before', 60000, 9, NULL)";
            assert_eq!(sqlx::query_scalar::<_, String>(claim).fetch_one(&mut old).await.unwrap(), expected);
        }
        let lattice = Lattice { origin: [0.0, 0.0], resolution: 0.5, cells: [4, 4] };
        let end = "UPDATE jobs SET status = 'successful', map_id = 'map' WHERE id = 'done'";
        old.execute(end).await.unwrap();
        sqlx::query(
            "INSERT INTO maps (id, job_id, tenant, labels, created, distance, lattice, fit, min_x, min_y, max_x, max_y, \
             prefix, bytes, sha256) VALUES ('map', 'done', 'a', '{}', 5, 'sdf', $1, $2, 0, 0, 2, 2, 'attempts/done/1', 7, 'af')",
        )
        .bind(serde_json::to_string(&lattice).unwrap())
        .bind(serde_json::to_string(&report()).unwrap())
        .execute(&mut old)
        .await
        .unwrap();
        old.execute("INSERT INTO places (tenant, name, version) VALUES ('a', 'hall', 1)").await.unwrap();
        let version = "INSERT INTO place_versions (tenant, name, version, map_id, published) \
                       VALUES ('a', 'hall', 1, 'map', 6)";
        old.execute(version).await.unwrap();
        old.close().await.unwrap();

        let store = PostgresStore::open(&url, 8).await.unwrap();
        // Of the lease of before: it is kept, and ends in a map.
        let running = store.job("a", "runs").await.unwrap().unwrap();
        assert_eq!((running.status, running.attempt, running.traceparent.as_deref()), (JobStatus::Running, 1, None));
        assert!(store.heartbeat("runs", 1, &DONE, LEASE).await.unwrap());
        assert!(store.succeed(1, &map_of(&running), &DONE).await.unwrap());
        let place = store.place("a", "hall").await.unwrap().unwrap();
        assert_eq!((&place.map_id[..], place.sha256.as_deref()), ("map", Some("af")));
        assert_eq!(store.map("a", "map").await.unwrap().unwrap().lattice, lattice);
        let labelled = Listing { labels: vec![("site".into(), "hq".into())], ..listing("a") };
        assert_eq!(store.jobs(&labelled).await.unwrap().len(), 4);
        // What waited goes before what is new, and is counted with it.
        let new = accept(&store, new_job("a", 0)).await;
        assert_eq!(store.holdings("a").await.unwrap().queued, 3);
        for (id, request) in [("waits", &b"waits"[..]), ("waits-too", b"waits-too"), (&new.id, b"request")] {
            let claim = store.claim(&terms("w")).await.unwrap().unwrap();
            assert_eq!((&claim.job.id[..], &claim.request[..]), (id, request));
        }
    });
}

/// A later version was here, and this one is started again beside it, in the middle of a rollout: it works.
async fn works(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    let claim = store.claim(&terms("w")).await.unwrap().unwrap();
    assert_eq!(claim.job.id, job.id);
    assert!(store.succeed(claim.job.attempt, &map_of(&claim.job), &DONE).await.unwrap());
    assert_eq!(store.job("a", &job.id).await.unwrap().unwrap().status, JobStatus::Successful);
}

/// As a migration leaves it that this version knows nothing of.
fn later(bytes: &str) -> [String; 2] {
    let row = format!(
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
         VALUES (9000, 'of a later version', true, {bytes}, 1)"
    );
    ["ALTER TABLE jobs ADD COLUMN colour TEXT".to_owned(), row]
}

#[test]
fn a_database_of_a_later_version_is_worked_with() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("jobs.sqlite");
    in_runtime(async {
        drop(SqliteStore::open(&file).await.unwrap());
        let mut other = SqliteConnection::connect(&address(&file)).await.unwrap();
        for statement in later("x'00'") {
            other.execute(AssertSqlSafe(statement)).await.unwrap();
        }
        other.close().await.unwrap();
        works(&SqliteStore::open(&file).await.unwrap()).await;

        let url = database();
        drop(PostgresStore::open(&url, 2).await.unwrap());
        let mut other = PgConnection::connect(&url).await.unwrap();
        for statement in later("'\\x00'") {
            other.execute(AssertSqlSafe(statement)).await.unwrap();
        }
        works(&PostgresStore::open(&url, 2).await.unwrap()).await;
    });
}

/// Submissions write jobs and then lanes, claims the other way round, and both go on while a new version brings the schema up
/// to date: it waits for them, and never they for it and it for them.
#[test]
fn a_schema_is_brought_up_to_date_beside_those_who_write() {
    in_runtime(async {
        for order in [["jobs", "lanes"], ["lanes", "jobs"]] {
            let url = database();
            let mut old = PgConnection::connect(&url).await.unwrap();
            first_of(5, "postgres").await.run(&mut old).await.unwrap();
            let write = |table: &str| AssertSqlSafe(format!("LOCK TABLE {table} IN ROW EXCLUSIVE MODE"));
            old.execute("BEGIN").await.unwrap();
            old.execute(write(order[0])).await.unwrap();
            let new = url.clone();
            let opened = tokio::spawn(async move { PostgresStore::open(&new, 2).await.map(drop) });
            let mut observer = PgConnection::connect(&url).await.unwrap();
            let waiting = "SELECT count(*) FROM pg_locks WHERE NOT granted AND locktype = 'relation' \
                           AND database = (SELECT oid FROM pg_database WHERE datname = current_database())";
            while sqlx::query_scalar::<_, i64>(waiting).fetch_one(&mut observer).await.unwrap() == 0 {
                assert!(!opened.is_finished(), "it waits for nobody");
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
            old.execute(write(order[1])).await.unwrap();
            old.execute("COMMIT").await.unwrap();
            opened.await.unwrap().unwrap();
        }
    });
}
