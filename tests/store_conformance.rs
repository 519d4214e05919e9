//! What every job store promises. One suite, run against each implementation.

use std::collections::BTreeMap;
use std::time::Duration;

use mapfit::fit::{Poses, Weighting, Weights};
use mapfit::jobs::{Job, JobStatus, MapRecord, ProblemReport, Progress};
use mapfit::map::FitReport;
use mapfit::spline::Lattice;
use mapfit::store::{Cancellation, JobStore, LEASE, Listing, MAX_ATTEMPTS, NewJob, Removal, SqliteStore, Submission};

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

async fn lists_go_by_status_labels_and_cursor(store: &dyn JobStore) {
    let labelled = |labels: &[(&str, &str)]| NewJob {
        labels: labels.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect(),
        ..new_job("a", 0)
    };
    let mut all = Vec::new();
    for k in 0..30 {
        let site = ("site", if k % 2 == 0 { "hq" } else { "lab" });
        let floor = ("floor", ["1", "2", "3"][k % 3]);
        all.push(accept(store, labelled(&[site, floor])).await.id);
    }
    accept(store, new_job("b", 0)).await;
    let ids = async |listing: Listing| -> Vec<String> {
        store.jobs(&listing).await.unwrap().into_iter().map(|job| job.id).collect()
    };
    let newest = |keep: &dyn Fn(usize) -> bool| -> Vec<String> {
        (0..30).rev().filter(|k| keep(*k)).map(|k| all[k].clone()).collect()
    };
    let label = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    assert_eq!(ids(listing("a")).await, newest(&|_| true));
    let hq = Listing { labels: vec![label("site", "hq")], ..listing("a") };
    assert_eq!(ids(hq.clone()).await, newest(&|k| k % 2 == 0));
    let both = Listing { labels: vec![label("site", "hq"), label("floor", "2"), label("site", "hq")], ..listing("a") };
    assert_eq!(ids(both.clone()).await, newest(&|k| k % 2 == 0 && k % 3 == 1));
    assert_eq!(
        ids(Listing { before: Some(all[16].clone()), limit: 2, ..both.clone() }).await,
        [&all[10], &all[4]].map(Clone::clone)
    );
    let contrary = Listing { labels: vec![label("site", "hq"), label("site", "lab")], ..listing("a") };
    assert!(ids(contrary).await.is_empty());
    let claimed = store.claim("w").await.unwrap().unwrap().job.id;
    let running = Listing { status: Some(JobStatus::Running), ..hq };
    assert_eq!(ids(running).await, std::slice::from_ref(&claimed).to_vec());
    assert!(ids(Listing { status: Some(JobStatus::Failed), ..both }).await.is_empty());
    assert_eq!(store.revisions(&[claimed.clone(), "gone".into()]).await.unwrap(), [(claimed, 2)]);
}

async fn maps_are_found_by_box_and_label(store: &dyn JobStore) {
    let mut made = Vec::new();
    for k in 0..6 {
        let job = accept(store, new_job("a", 0)).await;
        let claim = store.claim("w").await.unwrap().unwrap().job;
        let mut map = map_of(&claim);
        map.lattice.origin = [10.0 * f64::from(k), 0.0];
        map.labels = BTreeMap::from([("even".to_owned(), (k % 2 == 0).to_string())]);
        assert!(store.succeed(claim.attempt, &map).await.unwrap());
        made.push((job.id, map.id));
    }
    let ids = async |bbox, labels: Vec<(String, String)>| -> Vec<String> {
        let listing = Listing { bbox, labels, ..listing("a") };
        store.maps(&listing).await.unwrap().into_iter().map(|map| map.id).collect()
    };
    let middle = Some([11.0, 0.5, 31.0, 1.0]);
    assert_eq!(ids(middle, vec![]).await, [3, 2, 1].map(|k: usize| made[k].1.clone()));
    assert_eq!(ids(middle, vec![("even".into(), "true".into())]).await, [made[2].1.clone()]);
    assert!(ids(Some([3.0, 5.0, 4.0, 6.0]), vec![]).await.is_empty());
    // A job goes when its map is gone, and its labels and request with it.
    let (job, map) = &made[2];
    assert_eq!(store.remove_job("a", job).await.unwrap(), Removal::HasMap(map.clone()));
    assert!(store.delete_map("a", map).await.unwrap().is_some());
    assert!(ids(None, vec![("even".into(), "true".into())]).await.iter().all(|id| id != map));
    assert_eq!(store.remove_job("b", job).await.unwrap(), Removal::Unknown);
    assert_eq!(store.remove_job("a", job).await.unwrap(), Removal::Removed);
    assert!(store.request("a", job).await.unwrap().is_none());
    let waiting = accept(store, new_job("a", 0)).await;
    assert_eq!(store.remove_job("a", &waiting.id).await.unwrap(), Removal::NotEnded);
    store.probe().await.unwrap();
}

async fn two_claimers_never_get_the_same_job(store: &dyn JobStore) {
    for k in 0..40 {
        accept(store, new_job(["a", "b", "c"][k % 3], 0)).await;
    }
    let drain = async |name: &str| {
        let mut claimed = Vec::new();
        while let Some(claim) = store.claim(name).await.unwrap() {
            claimed.push(claim.job.id);
        }
        claimed
    };
    let (mut one, two) = tokio::join!(drain("w1"), drain("w2"));
    one.extend(two);
    one.sort_unstable();
    one.dedup();
    assert_eq!(one.len(), 40);
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
    lists_go_by_status_labels_and_cursor,
    maps_are_found_by_box_and_label,
    two_claimers_never_get_the_same_job,
);

/// A database as version 0.2.0 left it: its jobs are claimed, listed by label and asked for their requests as before.
#[test]
fn a_database_of_the_first_schema_is_brought_up_to_date() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("jobs.sqlite");
    tokio::runtime::Runtime::new().unwrap().block_on(async {
        use sqlx::Connection;
        let address = format!("sqlite://{}?mode=rwc", file.display());
        let mut old = sqlx::sqlite::SqliteConnection::connect(&address).await.unwrap();
        let mut migrations = sqlx::migrate!("migrations/sqlite");
        let first: Vec<_> = migrations.migrations.iter().take(1).cloned().collect();
        migrations.migrations = first.into();
        migrations.run(&mut old).await.unwrap();
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
        let claim = store.claim("w").await.unwrap().unwrap();
        assert_eq!((&claim.job.id[..8], claim.request), ("01900000", vec![0u8; 3]));
        assert_eq!(store.claim("w").await.unwrap().unwrap().request, vec![3u8; 3]);
        assert!(store.claim("w").await.unwrap().is_none());
    });
}

/// What a claim and a page cost with 100,000 jobs in the queue; printed, and held to the bars.
#[test]
#[ignore = "nightly: cargo test --release --test store_conformance -- --ignored --nocapture"]
fn claims_and_pages_at_a_hundred_thousand_jobs() {
    let folder = tempfile::tempdir().unwrap();
    tokio::runtime::Runtime::new().unwrap().block_on(async {
        let store = SqliteStore::open(&folder.path().join("jobs.sqlite")).await.unwrap();
        for k in 0..100_000 {
            let labels = BTreeMap::from([
                ("site".to_owned(), if k % 10 == 0 { "lab" } else { "hq" }.to_owned()),
                ("robot".to_owned(), (k % 10_000).to_string()),
            ]);
            let tenant = format!("t{}", k % 1000);
            accept(&store, NewJob { labels, ..new_job(&tenant, 0) }).await;
        }
        let p99 = |mut times: Vec<Duration>| {
            times.sort_unstable();
            times[times.len() * 99 / 100]
        };
        let mut claims = Vec::new();
        for _ in 0..1000 {
            let began = std::time::Instant::now();
            assert!(store.claim("w").await.unwrap().is_some());
            claims.push(began.elapsed());
        }
        let mut pages = Vec::new();
        for k in 0..500 {
            let labels = vec![("site".to_owned(), "hq".to_owned()), ("robot".to_owned(), (k * 7).to_string())];
            let status = Some(JobStatus::Accepted).filter(|_| k % 2 == 0);
            let began = std::time::Instant::now();
            store.jobs(&Listing { labels, status, limit: 51, ..listing(&format!("t{}", k * 7 % 1000)) }).await.unwrap();
            pages.push(began.elapsed());
        }
        let (claim, page) = (p99(claims), p99(pages));
        println!("99 % of claims within {claim:.1?}, of pages within {page:.1?}");
        assert!(claim <= Duration::from_millis(10) && page <= Duration::from_millis(5));
    });
}
