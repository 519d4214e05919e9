//! Solvers that go wrong: they panic, do not end, or do not even look whether they should; and a clock that jumps. Each costs
//! its own job what it must, and no other.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use mapfit::jobs::{Job, JobRequest, JobStatus, Limits};
use mapfit::map::{FittedMap, SurveyError};
use mapfit::store::{Artifacts, JobBoard, SqliteStore, Submission};
use mapfit::traces::Traces;
use mapfit::worker::{Follower, Rules, Solver, Solvers, Workshop, fit_request};

use crate::{TENANT, job, until};

/// What a solver does with the jobs of this seed; it fits all others.
const BAD: u64 = 7;

/// What goes wrong, as long as `fits_again` is not reached.
#[derive(Clone, Copy)]
enum Way {
    Panics,
    /// Until it is told to stop.
    Lasts,
    /// And does not look whether it is told anything.
    IsDeaf,
}

struct Bad {
    way: Way,
    /// Attempts at the bad job that go wrong.
    times: usize,
    begun: AtomicUsize,
    /// The test is over.
    over: Arc<AtomicBool>,
}

impl Solver for Bad {
    fn map_of(&self, request: &JobRequest, follower: &Follower<'_>) -> Result<FittedMap, SurveyError> {
        let bad = request.name.as_deref() == Some("experiment 1, bad");
        if bad && self.begun.fetch_add(1, Ordering::Relaxed) < self.times {
            let waits = |what: &AtomicBool| {
                while !what.load(Ordering::Relaxed) {
                    std::thread::sleep(Duration::from_millis(10));
                }
            };
            match self.way {
                Way::Panics => panic!("a wrong turn"),
                Way::Lasts => waits(follower.stop),
                Way::IsDeaf => waits(&self.over),
            }
        }
        fit_request(request, follower)
    }
}

/// A workshop of one solver thread, and its store.
struct Scene {
    store: Arc<SqliteStore>,
    solvers: Solvers,
    over: Arc<AtomicBool>,
}

impl Scene {
    async fn open(data: &Path, way: Way, times: usize) -> Self {
        Self::open_for(data, (way, times), Duration::from_secs(2)).await
    }

    /// Attempts may take so long.
    async fn open_for(data: &Path, (way, times): (Way, usize), attempt_within: Duration) -> Self {
        let store = Arc::new(SqliteStore::open(&data.join("mapfit.sqlite")).await.unwrap());
        let artifacts = Artifacts::in_folder(&data.join("artifacts")).unwrap();
        let rules = Rules {
            lease: Duration::from_secs(1),
            attempt_within,
            stops_within: Duration::from_millis(500),
            ..Rules::default()
        };
        let over = Arc::new(AtomicBool::new(false));
        let bad = Bad { way, times, begun: AtomicUsize::new(0), over: over.clone() };
        let workshop =
            Workshop::with_solver(store.clone(), artifacts, Limits::default(), rules, Traces::default(), Box::new(bad))
                .unwrap();
        let solvers = Solvers::start(workshop, 1, &tokio::runtime::Handle::current()).unwrap();
        Self { store, solvers, over }
    }

    async fn submit(&self, seed: u64) -> String {
        let mut new = job(seed);
        if seed == BAD {
            let mut request = crate::support::small(seed);
            request["name"] = "experiment 1, bad".into();
            new.request = zstd::encode_all(request.to_string().as_bytes(), 1).unwrap();
        }
        match self.store.submit(new).await.unwrap() {
            Submission::Accepted(job) => job.id,
            other => panic!("{other:?}"),
        }
    }

    async fn ended(&self, id: &str) -> Job {
        self.until(id, |job| job.status.has_ended()).await
    }

    async fn until(&self, id: &str, holds: impl Fn(&Job) -> bool) -> Job {
        until(&*self.store, id, holds).await
    }

    /// Its one thread ends in time, whatever a fit does.
    async fn close(self) {
        let begun = Instant::now();
        tokio::task::spawn_blocking(move || self.solvers.drain(Duration::from_millis(100))).await.unwrap();
        assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
        self.over.store(true, Ordering::Relaxed);
    }
}

fn kind(job: &Job) -> &str {
    job.problem.as_ref().map_or("none", |problem| &problem.r#type)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_panic_costs_an_attempt_and_no_worker() {
    let data = tempfile::tempdir().unwrap();
    let scene = Scene::open(data.path(), Way::Panics, 2).await;
    let (bad, good) = (scene.submit(BAD).await, scene.submit(1).await);
    assert_eq!(scene.ended(&good).await.status, JobStatus::Successful);
    let job = scene.ended(&bad).await;
    assert_eq!((job.status, job.attempt), (JobStatus::Successful, 3));
    scene.close().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn who_always_panics_fails() {
    let data = tempfile::tempdir().unwrap();
    let scene = Scene::open(data.path(), Way::Panics, usize::MAX).await;
    let (bad, good) = (scene.submit(BAD).await, scene.submit(1).await);
    let job = scene.ended(&bad).await;
    assert_eq!((job.status, kind(&job), job.attempt), (JobStatus::Failed, "/problems/solver-panicked", 3));
    assert!(job.problem.unwrap().detail.contains("a wrong turn"));
    assert_eq!(scene.ended(&good).await.status, JobStatus::Successful);
    scene.close().await;
}

/// Whether it listens or not, its time is up, and the only worker goes on to the next job.
#[tokio::test(flavor = "multi_thread")]
async fn a_fit_that_does_not_end_is_ended_or_left() {
    for way in [Way::Lasts, Way::IsDeaf] {
        let data = tempfile::tempdir().unwrap();
        let scene = Scene::open(data.path(), way, usize::MAX).await;
        let (bad, good) = (scene.submit(BAD).await, scene.submit(1).await);
        let job = scene.ended(&bad).await;
        assert_eq!((job.status, kind(&job), job.attempt), (JobStatus::Failed, "/problems/job-too-long", 1));
        assert_eq!(scene.ended(&good).await.status, JobStatus::Successful);
        scene.close().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_process_ends_though_a_fit_does_not() {
    let data = tempfile::tempdir().unwrap();
    let scene = Scene::open(data.path(), Way::IsDeaf, usize::MAX).await;
    let bad = scene.submit(BAD).await;
    scene.until(&bad, |job| job.status == JobStatus::Running).await;
    let store = scene.store.clone();
    scene.close().await;
    let job = store.job(TENANT, &bad).await.unwrap().unwrap();
    assert_eq!((job.status, job.attempt), (JobStatus::Accepted, 0), "handed back as if it had not been begun");
}

/// The database's clock jumps an hour ahead while a job runs: its lease has lapsed at once. It costs an attempt, and what the
/// first attempt still writes is refused.
#[tokio::test(flavor = "multi_thread")]
async fn a_clock_that_jumps_costs_an_attempt_and_no_job() {
    let data = tempfile::tempdir().unwrap();
    let scene = Scene::open_for(data.path(), (Way::Lasts, 1), Duration::from_secs(60)).await;
    let bad = scene.submit(BAD).await;
    scene.until(&bad, |job| job.status == JobStatus::Running).await;
    let mut other = {
        use sqlx::Connection;
        let file = data.path().join("mapfit.sqlite");
        sqlx::sqlite::SqliteConnection::connect(&format!("sqlite://{}", file.display())).await.unwrap()
    };
    // To every lease it is the same whether the clock goes on or its end comes nearer. The heart beats, so more than once.
    let begun = Instant::now();
    while scene.store.job(TENANT, &bad).await.unwrap().unwrap().message.is_none() {
        assert!(begun.elapsed() < Duration::from_secs(30), "nobody takes it for lost");
        sqlx::query("UPDATE jobs SET lease_until = lease_until - 3600000 WHERE status = 'running' AND attempt = 1")
            .execute(&mut other)
            .await
            .unwrap();
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    let job = scene.ended(&bad).await;
    assert_eq!((job.status, job.attempt), (JobStatus::Successful, 2));
    scene.close().await;
}
