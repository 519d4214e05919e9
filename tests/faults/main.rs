//! Writes that go wrong at named points, and the books afterwards: whatever is lost, committed unseen or late, every accepted
//! job ends once, with one map, and nothing lies about that no row names.

mod endings;
mod faulty;
mod ports;
#[path = "../support/postgres.rs"]
mod postgres_server;
mod solver;
#[path = "../support/mod.rs"]
mod support;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use faulty::{Fault, Faulty};
use mapfit::jobs::{Job, JobStatus, Limits, Progress};
use mapfit::store::{Artifacts, JobBoard, Listing, MapShelf, NewJob, PostgresStore, Records, SqliteStore, Submission};
use mapfit::traces::Traces;
use mapfit::worker::{Rules, Solvers, Workshop};
use support::small;

const TENANT: &str = "default";
const LEASE: Duration = Duration::from_millis(1500);
/// Later than a lease holds.
const LATE: Duration = Duration::from_millis(2500);
const JOBS: u64 = 3;

fn job(seed: u64) -> NewJob {
    let request = zstd::encode_all(small(seed).to_string().as_bytes(), 1).unwrap();
    NewJob {
        tenant: TENANT.into(),
        name: Some(format!("job {seed}")),
        labels: BTreeMap::new(),
        priority: 0,
        progress: Progress::queued(100),
        message: None,
        request,
        idempotency: Some((format!("key {seed}"), format!("digest {seed}"))),
        retry_of: None,
        deadline_seconds: None,
        traceparent: None,
        quota: None,
    }
}

fn listing() -> Listing {
    Listing { tenant: TENANT.into(), limit: 100, ..Listing::default() }
}

/// The kinds of stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Sqlite,
    Postgres,
}

impl Kind {
    /// An empty one.
    async fn open(self, data: &Path) -> Arc<dyn Records> {
        match self {
            Self::Sqlite => Arc::new(SqliteStore::open(&data.join("mapfit.sqlite")).await.unwrap()),
            Self::Postgres => Arc::new(PostgresStore::open(&postgres_server::database(), 8).await.unwrap()),
        }
    }
}

/// Waits until a job is as is asked.
async fn until(store: &dyn JobBoard, id: &str, holds: impl Fn(&Job) -> bool) -> Job {
    let begun = Instant::now();
    loop {
        let job = store.job(TENANT, id).await.unwrap().unwrap();
        if holds(&job) {
            return job;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{job:?}");
        tokio::time::sleep(Duration::from_millis(30)).await;
    }
}

/// Submits until the store says that it has the job, as a client with an idempotency key does.
async fn submitted(store: &Faulty, seed: u64) -> String {
    for _ in 0..10 {
        match store.submit(job(seed)).await {
            Ok(Submission::Accepted(job) | Submission::Repeated(job)) => return job.id.clone(),
            Ok(other) => panic!("{other:?}"),
            Err(_) => tokio::time::sleep(Duration::from_millis(20)).await,
        }
    }
    panic!("no submission got through");
}

fn files_under(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let count = |path: std::path::PathBuf| if path.is_dir() { files_under(&path) } else { 1 };
    entries.map(|entry| count(entry.unwrap().path())).sum()
}

/// Runs a few jobs while two writes go wrong at a point, and checks the books.
async fn books_balance_after(kind: Kind, point: &'static str, fault: Fault) {
    let data = tempfile::tempdir().unwrap();
    let store = Arc::new(Faulty::new(kind.open(data.path()).await));
    let artifacts = Artifacts::in_folder(&data.path().join("artifacts")).unwrap();
    let rules = Rules { lease: LEASE, sweep_every: Duration::from_millis(500), ..Rules::default() };
    let workshop = Workshop::new(store.clone(), artifacts, Limits::default(), rules, Traces::default()).unwrap();
    store.plan(point, fault, 2);
    if point == "retry" {
        // What has to be tried again is what could not be finished.
        store.plan("succeed", Fault::Before, 2);
    }
    let mut accepted = Vec::new();
    for seed in 0..JOBS {
        accepted.push(submitted(&store, seed).await);
    }
    let solvers = Solvers::start(workshop.clone(), 2, &tokio::runtime::Handle::current()).unwrap();
    let begun = Instant::now();
    for id in &accepted {
        loop {
            let job = store.job(TENANT, id).await.unwrap().expect("an accepted job is there");
            match job.status {
                JobStatus::Successful => break,
                JobStatus::Accepted | JobStatus::Running => {}
                ended => panic!("{kind:?} {point} {fault:?}: {ended:?} {:?}", job.problem),
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "{kind:?} {point} {fault:?}: {job:?}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
    while store.left(point) > 0 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{kind:?} {point}: not every fault came");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    assert_eq!(
        store.jobs(&listing()).await.unwrap().len(),
        accepted.len(),
        "{kind:?} {point} {fault:?}: jobs are doubled"
    );
    let maps = store.maps(&listing()).await.unwrap();
    let mut of_jobs: Vec<&str> = maps.iter().map(|map| map.job_id.as_str()).collect();
    of_jobs.sort_unstable();
    of_jobs.dedup();
    assert_eq!(
        (maps.len(), of_jobs.len()),
        (accepted.len(), accepted.len()),
        "{kind:?} {point} {fault:?}: a map a job"
    );
    tokio::task::spawn_blocking(move || solvers.drain(Duration::from_secs(5))).await.unwrap();
    for map in &maps {
        let bytes = workshop.artifacts.get(&map.prefix, mapfit::store::MAP_FILE, map.sha256.as_deref()).await;
        assert!(
            bytes.is_ok_and(|bytes| bytes.len() as i64 == map.bytes),
            "{kind:?} {point} {fault:?}: an artifact is missing"
        );
    }
    // Attempts that were lost are swept once they are old enough; none lies about twice.
    let files = files_under(&data.path().join("artifacts").join("attempts"));
    assert!(
        files >= maps.len() && files <= maps.len() + 4,
        "{kind:?} {point} {fault:?}: {files} files for {} maps",
        maps.len()
    );
}

/// Each point with each fault, on both kinds of stores at a time.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn whatever_write_goes_wrong_the_books_balance() {
    for point in ["submit", "claim", "heartbeat", "succeed", "retry", "reap"] {
        for fault in Fault::all(LATE) {
            println!("{point} {fault:?}");
            tokio::join!(
                books_balance_after(Kind::Sqlite, point, fault),
                books_balance_after(Kind::Postgres, point, fault)
            );
        }
    }
}
