//! The other ways in which an attempt ends: it fails, it is handed back, its job is cancelled. Whatever goes wrong with the
//! write, there is one ending, the right one, and no map where there should be none.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use mapfit::fit::FitError;
use mapfit::jobs::{Job, JobRequest, JobStatus, Limits};
use mapfit::map::{FittedMap, SurveyError};
use mapfit::store::{Artifacts, Cancellation, JobBoard, MapShelf};
use mapfit::traces::Traces;
use mapfit::worker::{Follower, Rules, Solver, Solvers, Workshop, fit_request};

use crate::faulty::{Fault, Faulty};
use crate::{Kind, LATE, LEASE, TENANT, listing, submitted, until};

/// What the solver makes of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Fits,
    Fails,
    /// Until it is told to stop.
    Lasts,
}

struct Told(Way);

impl Solver for Told {
    fn map_of(&self, request: &JobRequest, follower: &Follower<'_>) -> Result<FittedMap, SurveyError> {
        match self.0 {
            Way::Fails => return Err(SurveyError::NoReturns),
            Way::Fits => {}
            Way::Lasts => {
                let told = |stop: &AtomicBool| stop.load(Ordering::Relaxed);
                while !told(follower.stop) {
                    std::thread::sleep(Duration::from_millis(5));
                }
                return Err(SurveyError::Fit(FitError::Cancelled));
            }
        }
        fit_request(request, follower)
    }
}

/// A store whose writes go wrong, and those who work on it.
struct Scene {
    store: Arc<Faulty>,
    folder: std::path::PathBuf,
}

impl Scene {
    async fn open(kind: Kind, data: &Path) -> Self {
        Self { store: Arc::new(Faulty::new(kind.open(data).await)), folder: data.join("artifacts") }
    }

    /// A solver thread in a process of its own, as far as the store can tell.
    fn solvers(&self, way: Way) -> Solvers {
        let rules = Rules {
            lease: LEASE,
            sweep_every: Duration::from_millis(500),
            stops_within: Duration::from_millis(500),
            ..Rules::default()
        };
        let artifacts = Artifacts::in_folder(&self.folder).unwrap();
        let solver = Box::new(Told(way));
        let workshop =
            Workshop::with_solver(self.store.clone(), artifacts, Limits::default(), rules, Traces::default(), solver)
                .unwrap();
        Solvers::start(workshop, 1, &tokio::runtime::Handle::current()).unwrap()
    }

    async fn until(&self, id: &str, holds: impl Fn(&Job) -> bool) -> Job {
        until(&*self.store, id, holds).await
    }

    async fn close(&self, solvers: Solvers) {
        tokio::task::spawn_blocking(move || solvers.drain(Duration::from_millis(100))).await.unwrap();
    }

    async fn maps(&self) -> usize {
        self.store.maps(&listing()).await.unwrap().len()
    }
}

async fn a_failure_is_told_once(kind: Kind, fault: Fault) {
    let data = tempfile::tempdir().unwrap();
    let scene = Scene::open(kind, data.path()).await;
    scene.store.plan("fail", fault, 1);
    let id = submitted(&scene.store, 1).await;
    let solvers = scene.solvers(Way::Fails);
    let job = scene.until(&id, |job| job.status.has_ended()).await;
    let problem = job.problem.as_ref().map(|problem| problem.r#type.as_str());
    assert_eq!((job.status, problem), (JobStatus::Failed, Some("/problems/fit-failed")), "{kind:?} {fault:?}: {job:?}");
    assert_eq!((scene.store.left("fail"), scene.maps().await), (0, 0), "{kind:?} {fault:?}");
    scene.close(solvers).await;
}

async fn what_is_handed_back_is_done(kind: Kind, fault: Fault) {
    let data = tempfile::tempdir().unwrap();
    let scene = Scene::open(kind, data.path()).await;
    scene.store.plan("release", fault, 1);
    let id = submitted(&scene.store, 1).await;
    let leaving = scene.solvers(Way::Lasts);
    scene.until(&id, |job| job.status == JobStatus::Running).await;
    scene.close(leaving).await;
    assert_eq!(scene.store.left("release"), 0, "{kind:?} {fault:?}");
    let solvers = scene.solvers(Way::Fits);
    let job = scene.until(&id, |job| job.status.has_ended()).await;
    assert_eq!((job.status, scene.maps().await), (JobStatus::Successful, 1), "{kind:?} {fault:?}: {job:?}");
    scene.close(solvers).await;
}

async fn what_is_cancelled_stays_cancelled(kind: Kind, fault: Fault) {
    let data = tempfile::tempdir().unwrap();
    let scene = Scene::open(kind, data.path()).await;
    scene.store.plan("cancel", fault, 1);
    let id = submitted(&scene.store, 1).await;
    let solvers = scene.solvers(Way::Lasts);
    scene.until(&id, |job| job.status == JobStatus::Running).await;
    // A client asks again where nobody answered.
    let mut asked = 0;
    let answer = loop {
        asked += 1;
        match scene.store.cancel(TENANT, &id).await {
            Ok(answer) => break answer,
            Err(_) => assert!(asked < 3, "{kind:?} {fault:?}"),
        }
    };
    assert!(!matches!(answer, Cancellation::Unknown), "{kind:?} {fault:?}: {answer:?}");
    let job = scene.until(&id, |job| job.status.has_ended()).await;
    assert_eq!((job.status, scene.maps().await), (JobStatus::Dismissed, 0), "{kind:?} {fault:?}");
    scene.close(solvers).await;
}

/// Each ending with each fault, on both kinds of stores at a time.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn whatever_ending_goes_wrong_is_one_ending() {
    for fault in Fault::all(LATE) {
        println!("{fault:?}");
        for kind in [Kind::Sqlite, Kind::Postgres] {
            tokio::join!(
                a_failure_is_told_once(kind, fault),
                what_is_handed_back_is_done(kind, fault),
                what_is_cancelled_stays_cancelled(kind, fault)
            );
        }
    }
}
