//! What every job store promises. One suite, run against each implementation.

use std::collections::BTreeMap;
use std::time::Duration;

use mapfit::fit::{Poses, Weighting, Weights};
use mapfit::jobs::{Job, JobStatus, MapRecord, ProblemReport, Progress};
use mapfit::map::FitReport;
use mapfit::spline::Lattice;
use mapfit::store::{Cancellation, JobStore, LEASE, Listing, MAX_ATTEMPTS, NewJob, SqliteStore, Submission};

fn new_job(tenant: &str, priority: i32) -> NewJob {
    NewJob {
        tenant: tenant.into(),
        name: None,
        labels: BTreeMap::new(),
        priority,
        progress: Progress::queued(100),
        message: None,
        request: b"request".to_vec(),
        idempotency: None,
    }
}

async fn accept(store: &dyn JobStore, job: NewJob) -> Job {
    match store.submit(job).await.unwrap() {
        Submission::Accepted(job) => job,
        other => panic!("{other:?}"),
    }
}

fn map_of(job: &Job) -> MapRecord {
    let weights = Weights {
        eikonal: 1.0,
        eikonal_unit: String::new(),
        eikonal_scale: None,
        smoothing: 0.0,
        observation: String::new(),
        model_sigma: 0.0,
        poses: Poses::Fixed,
    };
    let fit = FitReport {
        weighting: Weighting::Paper,
        converged: true,
        iterations: 7,
        factorisations: 9,
        objective: 1.0,
        gradient_norm: 0.0,
        relative_gradient: 0.0,
        positive_definite: true,
        observations: 1,
        seconds: 0.1,
        stages: Default::default(),
        unconverged: None,
        weights,
        seen_through: None,
        cut_locus: None,
        active_control_points: None,
    };
    MapRecord {
        id: uuid::Uuid::now_v7().to_string(),
        job_id: job.id.clone(),
        tenant: job.tenant.clone(),
        name: None,
        labels: BTreeMap::new(),
        created: 0,
        distance: mapfit::fit::Distance::Signed,
        lattice: Lattice { origin: [0.0, 0.0], resolution: 0.5, cells: [4, 4] },
        fit,
        prefix: format!("attempts/{}/{}", job.id, job.attempt),
    }
}

async fn claims_go_by_priority_then_fairness_then_age(store: &dyn JobStore) {
    let a1 = accept(store, new_job("a", 0)).await;
    let a2 = accept(store, new_job("a", 0)).await;
    let b1 = accept(store, new_job("b", 0)).await;
    let urgent = accept(store, new_job("a", 5)).await;
    let mut order = vec![];
    while let Some(claim) = store.claim("w").await.unwrap() {
        assert_eq!((claim.job.status, claim.job.attempt), (JobStatus::Running, 1));
        assert_eq!(claim.request, b"request");
        order.push(claim.job.id);
    }
    // After the urgent one, tenant a has a job running, so b's turn comes first.
    assert_eq!(order, [urgent.id, b1.id, a1.id, a2.id]);
}

async fn a_lost_lease_never_writes(store: &dyn JobStore) {
    let job = accept(store, new_job("a", 0)).await;
    let first = store.claim("w1").await.unwrap().unwrap().job;
    assert!(store.heartbeat(&job.id, first.attempt, &Progress::queued(5)).await.unwrap());
    assert!(store.retry(&job.id, first.attempt, Duration::ZERO, "test").await.unwrap());
    let second = store.claim("w2").await.unwrap().unwrap().job;
    assert_eq!(second.attempt, 2);
    // The first attempt comes back late, in every way it could.
    assert!(!store.heartbeat(&job.id, 1, &Progress::queued(5)).await.unwrap());
    assert!(!store.succeed(1, &map_of(&first)).await.unwrap());
    let problem = ProblemReport { r#type: "/p".into(), title: "t".into(), status: 500, detail: "d".into() };
    assert!(!store.fail(&job.id, 1, &problem).await.unwrap());
    assert!(!store.release(&job.id, 1).await.unwrap());
    assert!(!store.retry(&job.id, 1, Duration::ZERO, "late").await.unwrap());
    assert!(store.maps(&listing("a")).await.unwrap().is_empty());
    assert!(store.owns_prefix("attempts/x/2", &job.id, 2).await.unwrap());
    let map = map_of(&second);
    assert!(store.succeed(2, &map).await.unwrap());
    assert!(!store.succeed(2, &map_of(&second)).await.unwrap(), "a job succeeds once");
    let done = store.job("a", &job.id).await.unwrap().unwrap();
    assert_eq!((done.status, done.map_id.as_deref()), (JobStatus::Successful, Some(map.id.as_str())));
    assert_eq!(done.progress.max_iterations, 5);
    assert!(store.owns_prefix(&map.prefix, &job.id, 2).await.unwrap());
    assert!(!store.owns_prefix("attempts/x/1", &job.id, 1).await.unwrap());
}

async fn a_cancelled_job_takes_no_result(store: &dyn JobStore) {
    let job = accept(store, new_job("a", 0)).await;
    assert_eq!(store.cancel("b", &job.id).await.unwrap(), Cancellation::Unknown, "another tenant's job is unknown");
    let running = store.claim("w").await.unwrap().unwrap().job;
    assert!(matches!(store.cancel("a", &job.id).await.unwrap(), Cancellation::Dismissed(_)));
    assert!(!store.succeed(running.attempt, &map_of(&running)).await.unwrap());
    assert!(matches!(store.cancel("a", &job.id).await.unwrap(), Cancellation::AlreadyEnded(_)));
    assert!(store.claim("w").await.unwrap().is_none());
}

async fn a_released_job_is_as_if_never_claimed(store: &dyn JobStore) {
    let job = accept(store, new_job("a", 0)).await;
    store.claim("w").await.unwrap().unwrap();
    assert!(store.release(&job.id, 1).await.unwrap());
    let back = store.job("a", &job.id).await.unwrap().unwrap();
    assert_eq!((back.status, back.attempt), (JobStatus::Accepted, 0));
    assert!(!store.retry(&job.id, 1, Duration::ZERO, "late").await.unwrap());
}

async fn a_retry_waits_its_delay(store: &dyn JobStore) {
    let job = accept(store, new_job("a", 0)).await;
    store.claim("w").await.unwrap().unwrap();
    assert!(store.retry(&job.id, 1, Duration::from_millis(300), "disk").await.unwrap());
    assert!(store.claim("w").await.unwrap().is_none());
    tokio::time::sleep(Duration::from_millis(400)).await;
    assert_eq!(store.claim("w").await.unwrap().unwrap().job.attempt, 2);
}

async fn idempotency_keys_belong_to_a_tenant(store: &dyn JobStore) {
    let keyed =
        |tenant: &str, body: &str| NewJob { idempotency: Some(("k".into(), body.into())), ..new_job(tenant, 0) };
    let first = accept(store, keyed("a", "one")).await;
    let Submission::Repeated(again) = store.submit(keyed("a", "one")).await.unwrap() else { panic!() };
    assert_eq!(again.id, first.id);
    assert_eq!(store.submit(keyed("a", "two")).await.unwrap(), Submission::KeyReused);
    accept(store, keyed("b", "two")).await;
}

async fn lapsed_leases_cost_attempts_until_the_job_fails(store: &dyn JobStore) {
    let job = accept(store, new_job("a", 0)).await;
    for attempt in 1..=MAX_ATTEMPTS {
        assert_eq!(store.claim("w").await.unwrap().unwrap().job.attempt, attempt);
        assert_eq!(store.reap().await.unwrap(), 0, "a lease that holds is left alone");
        tokio::time::sleep(LEASE + Duration::from_millis(300)).await;
        assert_eq!(store.reap().await.unwrap(), 1);
        let expected = if attempt < MAX_ATTEMPTS { JobStatus::Accepted } else { JobStatus::Failed };
        let after = store.job("a", &job.id).await.unwrap().unwrap();
        assert_eq!(after.status, expected);
        assert_eq!(after.problem.is_some(), expected == JobStatus::Failed);
    }
    assert!(store.claim("w").await.unwrap().is_none());
}

fn listing(tenant: &str) -> Listing {
    Listing { tenant: tenant.into(), limit: 100, ..Default::default() }
}

/// Runs a case of the suite on a fresh store of each kind.
macro_rules! conformance {
    ($($case:ident),* $(,)?) => {
        mod sqlite {
            $(#[test]
            fn $case() {
                let folder = tempfile::tempdir().unwrap();
                tokio::runtime::Runtime::new().unwrap().block_on(async {
                    let store = super::SqliteStore::open(&folder.path().join("jobs.sqlite")).await.unwrap();
                    super::$case(&store).await;
                });
            })*
        }
    };
}

conformance!(
    claims_go_by_priority_then_fairness_then_age,
    a_lost_lease_never_writes,
    a_cancelled_job_takes_no_result,
    a_released_job_is_as_if_never_claimed,
    a_retry_waits_its_delay,
    idempotency_keys_belong_to_a_tenant,
    lapsed_leases_cost_attempts_until_the_job_fails,
);
