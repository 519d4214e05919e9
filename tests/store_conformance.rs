//! What every job store promises. One suite, run against each implementation.

#[path = "support/postgres.rs"]
mod postgres_server;

use std::collections::BTreeMap;
use std::time::Duration;

use mapfit::fit::{Poses, Weighting, Weights};
use mapfit::jobs::lifecycle::{MAX_ATTEMPTS, after_lapse};
use mapfit::jobs::{Job, JobStatus, MapRecord, ProblemReport, Progress};
use mapfit::map::FitReport;
use mapfit::spline::Lattice;
use mapfit::store::{
    Cancellation, Delivered, DeliveryStatus, Guard, Holdings, JobBoard, Leases, Listing, MapRemoval, NewJob, NewKey,
    NewWebhook, Place, PostgresStore, Publication, Quota, Records, Relabelling, Removal, SqliteStore, Submission,
    Terms,
};

const LEASE: Duration = Duration::from_millis(400);

fn terms(worker: &str) -> Terms {
    Terms { worker: worker.into(), lease: LEASE, running_a_tenant: i64::MAX }
}

const QUEUED: Progress =
    Progress { percent: 0.0, stage: String::new(), iteration: 0, max_iterations: 5, objective: None };
const DONE: Progress = QUEUED;

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
        retry_of: None,
        deadline_seconds: None,
        quota: None,
    }
}

async fn accept(store: &dyn Records, job: NewJob) -> Job {
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
        bytes: 1000,
        sha256: Some("0af3".into()),
        parent: None,
        version: 1,
    }
}

async fn claims_go_by_priority_then_fairness_then_age(store: &dyn Records) {
    let a1 = accept(store, new_job("a", 0)).await;
    let a2 = accept(store, new_job("a", 0)).await;
    let b1 = accept(store, new_job("b", 0)).await;
    let urgent = accept(store, new_job("a", 5)).await;
    let mut order = vec![];
    while let Some(claim) = store.claim(&terms("w")).await.unwrap() {
        assert_eq!((claim.job.status, claim.job.attempt), (JobStatus::Running, 1));
        assert_eq!(claim.request, b"request");
        order.push(claim.job.id);
    }
    // After the urgent one, tenant a has a job running, so b's turn comes first.
    assert_eq!(order, [urgent.id, b1.id, a1.id, a2.id]);
}

async fn a_lost_lease_never_writes(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    let first = store.claim(&terms("w1")).await.unwrap().unwrap().job;
    assert!(store.heartbeat(&job.id, first.attempt, &Progress::queued(5), LEASE).await.unwrap());
    assert!(store.retry(&job.id, first.attempt, Duration::ZERO, "test", &QUEUED).await.unwrap());
    let second = store.claim(&terms("w2")).await.unwrap().unwrap().job;
    assert_eq!(second.attempt, 2);
    // The first attempt comes back late, in every way it could.
    assert!(!store.heartbeat(&job.id, 1, &Progress::queued(5), LEASE).await.unwrap());
    assert!(!store.succeed(1, &map_of(&first), &DONE).await.unwrap());
    let problem = ProblemReport { r#type: "/p".into(), title: "t".into(), status: 500, detail: "d".into() };
    assert!(!store.fail(&job.id, 1, &problem).await.unwrap());
    assert!(!store.release(&job.id, 1, &QUEUED).await.unwrap());
    assert!(!store.retry(&job.id, 1, Duration::ZERO, "late", &QUEUED).await.unwrap());
    assert!(store.maps(&listing("a")).await.unwrap().is_empty());
    assert!(store.owns_prefix("attempts/x/2", &job.id, 2).await.unwrap());
    let map = map_of(&second);
    assert!(store.succeed(2, &map, &DONE).await.unwrap());
    assert!(!store.succeed(2, &map_of(&second), &DONE).await.unwrap(), "a job succeeds once");
    let done = store.job("a", &job.id).await.unwrap().unwrap();
    assert_eq!((done.status, done.map_id.as_deref()), (JobStatus::Successful, Some(map.id.as_str())));
    assert_eq!(done.progress.max_iterations, 5);
    assert!(store.owns_prefix(&map.prefix, &job.id, 2).await.unwrap());
    assert!(!store.owns_prefix("attempts/x/1", &job.id, 1).await.unwrap());
}

async fn a_cancelled_job_takes_no_result(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    assert_eq!(store.cancel("b", &job.id).await.unwrap(), Cancellation::Unknown, "another tenant's job is unknown");
    let running = store.claim(&terms("w")).await.unwrap().unwrap().job;
    assert!(matches!(store.cancel("a", &job.id).await.unwrap(), Cancellation::Dismissed(_)));
    assert!(!store.succeed(running.attempt, &map_of(&running), &DONE).await.unwrap());
    assert!(matches!(store.cancel("a", &job.id).await.unwrap(), Cancellation::AlreadyEnded(_)));
    assert!(store.claim(&terms("w")).await.unwrap().is_none());
}

async fn a_released_job_is_as_if_never_claimed(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    store.claim(&terms("w")).await.unwrap().unwrap();
    assert!(store.release(&job.id, 1, &QUEUED).await.unwrap());
    let back = store.job("a", &job.id).await.unwrap().unwrap();
    assert_eq!((back.status, back.attempt), (JobStatus::Accepted, 0));
    assert!(!store.retry(&job.id, 1, Duration::ZERO, "late", &QUEUED).await.unwrap());
}

async fn a_retry_waits_its_delay(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    store.claim(&terms("w")).await.unwrap().unwrap();
    assert!(store.retry(&job.id, 1, Duration::from_millis(300), "disk", &QUEUED).await.unwrap());
    assert!(store.claim(&terms("w")).await.unwrap().is_none());
    tokio::time::sleep(Duration::from_millis(400)).await;
    assert_eq!(store.claim(&terms("w")).await.unwrap().unwrap().job.attempt, 2);
}

async fn idempotency_keys_belong_to_a_tenant(store: &dyn Records) {
    let keyed =
        |tenant: &str, body: &str| NewJob { idempotency: Some(("k".into(), body.into())), ..new_job(tenant, 0) };
    let first = accept(store, keyed("a", "one")).await;
    let Submission::Repeated(again) = store.submit(keyed("a", "one")).await.unwrap() else { panic!() };
    assert_eq!(again.id, first.id);
    assert_eq!(store.submit(keyed("a", "two")).await.unwrap(), Submission::KeyReused);
    accept(store, keyed("b", "two")).await;
}

async fn lapsed_leases_cost_attempts_until_the_job_fails(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    for attempt in 1..=MAX_ATTEMPTS {
        assert_eq!(store.claim(&terms("w")).await.unwrap().unwrap().job.attempt, attempt);
        assert_eq!(store.reap(after_lapse).await.unwrap(), 0, "a lease that holds is left alone");
        tokio::time::sleep(LEASE + Duration::from_millis(300)).await;
        assert_eq!(store.reap(after_lapse).await.unwrap(), 1);
        let expected = if attempt < MAX_ATTEMPTS { JobStatus::Accepted } else { JobStatus::Failed };
        let after = store.job("a", &job.id).await.unwrap().unwrap();
        assert_eq!(after.status, expected);
        assert_eq!(after.problem.is_some(), expected == JobStatus::Failed);
    }
    assert!(store.claim(&terms("w")).await.unwrap().is_none());
}

async fn lists_go_by_status_labels_and_cursor(store: &dyn Records) {
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
    let claimed = store.claim(&terms("w")).await.unwrap().unwrap().job.id;
    let running = Listing { status: Some(JobStatus::Running), ..hq };
    assert_eq!(ids(running).await, std::slice::from_ref(&claimed).to_vec());
    assert!(ids(Listing { status: Some(JobStatus::Failed), ..both }).await.is_empty());
    assert_eq!(store.revisions(&[claimed.clone(), "gone".into()]).await.unwrap(), [(claimed, 2)]);
}

async fn maps_are_found_by_box_and_label(store: &dyn Records) {
    let mut made = Vec::new();
    for k in 0..6 {
        let labels = BTreeMap::from([("even".to_owned(), (k % 2 == 0).to_string())]);
        let job = accept(store, NewJob { labels, ..new_job("a", 0) }).await;
        let claim = store.claim(&terms("w")).await.unwrap().unwrap().job;
        let mut map = map_of(&claim);
        map.lattice.origin = [10.0 * f64::from(k), 0.0];
        assert!(store.succeed(claim.attempt, &map, &DONE).await.unwrap());
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
    assert!(matches!(store.remove_map("a", map).await.unwrap(), MapRemoval::Removed(_)));
    assert!(ids(None, vec![("even".into(), "true".into())]).await.iter().all(|id| id != map));
    assert_eq!(store.remove_job("b", job).await.unwrap(), Removal::Unknown);
    assert_eq!(store.remove_job("a", job).await.unwrap(), Removal::Removed);
    assert!(store.request("a", job).await.unwrap().is_none());
    let waiting = accept(store, new_job("a", 0)).await;
    assert_eq!(store.remove_job("a", &waiting.id).await.unwrap(), Removal::NotEnded);
    store.probe().await.unwrap();
}

async fn two_claimers_never_get_the_same_job(store: &dyn Records) {
    for k in 0..40 {
        accept(store, new_job(["a", "b", "c"][k % 3], 0)).await;
    }
    let drain = async |name: &str| {
        let mut claimed = Vec::new();
        while let Some(claim) = store.claim(&terms(name)).await.unwrap() {
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

/// A finished map of a tenant.
async fn mapped(store: &dyn Records, tenant: &str) -> (Job, MapRecord) {
    let job = accept(store, new_job(tenant, 1000)).await;
    let claim = store.claim(&terms("w")).await.unwrap().unwrap().job;
    assert_eq!(claim.id, job.id);
    let map = map_of(&claim);
    assert!(store.succeed(claim.attempt, &map, &DONE).await.unwrap());
    (store.job(tenant, &job.id).await.unwrap().unwrap(), map)
}

async fn a_tenant_runs_no_more_than_it_may(store: &dyn Records) {
    for tenant in ["a", "a", "a", "b"] {
        accept(store, new_job(tenant, 0)).await;
    }
    let one = Terms { running_a_tenant: 1, ..terms("w") };
    let first = store.claim(&one).await.unwrap().unwrap().job;
    let second = store.claim(&one).await.unwrap().unwrap().job;
    assert_eq!((&first.tenant[..], &second.tenant[..]), ("a", "b"));
    assert!(store.claim(&one).await.unwrap().is_none(), "a has one job running");
    assert!(store.succeed(1, &map_of(&first), &DONE).await.unwrap());
    assert_eq!(store.claim(&one).await.unwrap().unwrap().job.tenant, "a");
}

async fn holdings_and_quotas_count_what_is_there(store: &dyn Records) {
    let quota = Some(Quota { queued: 2, bytes: 1000 });
    accept(store, NewJob { quota, ..new_job("a", 0) }).await;
    let second = accept(store, NewJob { quota, ..new_job("a", 0) }).await;
    let over = store.submit(NewJob { quota, ..new_job("a", 0) }).await.unwrap();
    assert_eq!(over, Submission::OverQuota("queued jobs"));
    accept(store, NewJob { quota, ..new_job("b", 0) }).await;
    assert!(matches!(store.cancel("a", &second.id).await.unwrap(), Cancellation::Dismissed(_)));
    assert_eq!(store.holdings("a").await.unwrap(), Holdings { queued: 1, running: 0, maps: 0, bytes: 0 });
    let (_, map) = mapped(store, "a").await;
    assert_eq!(store.holdings("a").await.unwrap(), Holdings { queued: 1, running: 0, maps: 1, bytes: 1000 });
    let over = store.submit(NewJob { quota, ..new_job("a", 0) }).await.unwrap();
    assert_eq!(over, Submission::OverQuota("bytes of maps"));
    let (all, oldest) = store.totals().await.unwrap();
    assert_eq!((all.queued, all.maps, oldest.is_some()), (2, 1, true));
    assert!(matches!(store.remove_map("a", &map.id).await.unwrap(), MapRemoval::Removed(_)));
    assert_eq!(store.holdings("a").await.unwrap().bytes, 0);
    assert_eq!(store.holdings("nobody").await.unwrap(), Holdings::default());
}

async fn a_deadline_fails_what_waits_and_what_runs(store: &dyn Records) {
    let late = NewJob { deadline_seconds: Some(0.2), ..new_job("a", 0) };
    let runs = accept(store, late.clone()).await;
    let claim = store.claim(&terms("w")).await.unwrap().unwrap().job;
    let waits = accept(store, late).await;
    assert!(waits.deadline.unwrap() >= waits.created + 199);
    accept(store, NewJob { deadline_seconds: Some(60.0), ..new_job("a", 0) }).await;
    assert_eq!(store.reap(after_lapse).await.unwrap(), 0);
    tokio::time::sleep(Duration::from_millis(250)).await;
    assert_eq!(store.reap(after_lapse).await.unwrap(), 2);
    for id in [&runs.id, &waits.id] {
        let job = store.job("a", id).await.unwrap().unwrap();
        assert_eq!(
            (job.status, job.problem.unwrap().r#type),
            (JobStatus::Failed, "/problems/deadline-passed".to_owned())
        );
    }
    assert!(!store.succeed(claim.attempt, &map_of(&claim), &DONE).await.unwrap());
}

async fn labels_are_replaced_and_found_by(store: &dyn Records) {
    let (job, map) = mapped(store, "a").await;
    let labels = BTreeMap::from([("site".to_owned(), "hq".to_owned())]);
    let change = Relabelling { name: Some(Some("hall".into())), labels: Some(labels.clone()) };
    let changed = store.relabel_job("a", &job.id, &change).await.unwrap().unwrap();
    assert_eq!((changed.name.as_deref(), &changed.labels), (Some("hall"), &labels));
    assert!(changed.revision > job.revision);
    assert!(store.relabel_map("a", &map.id, &change).await.unwrap().is_some());
    let hq = Listing { labels: vec![("site".into(), "hq".into())], ..listing("a") };
    assert_eq!((store.jobs(&hq).await.unwrap().len(), store.maps(&hq).await.unwrap().len()), (1, 1));
    let unlabel = Relabelling { name: None, labels: Some(BTreeMap::new()) };
    let map = store.relabel_map("a", &map.id, &unlabel).await.unwrap().unwrap();
    assert_eq!((map.name.as_deref(), map.labels.len()), (Some("hall"), 0), "the name stays");
    assert!(store.maps(&hq).await.unwrap().is_empty());
    assert!(store.relabel_map("b", &map.id, &change).await.unwrap().is_none());
    assert!(store.relabel_job("b", &job.id, &change).await.unwrap().is_none());
}

async fn published(store: &dyn Records, map: &MapRecord, guard: &Guard) -> Option<Place> {
    match store.publish("a", "hall", &map.id, Some("note"), guard).await.unwrap() {
        Publication::Published(place) => Some(place),
        Publication::Refused => None,
        Publication::NoMap => panic!("no map"),
    }
}

async fn versions_of_a_place_follow_one_another(store: &dyn Records) {
    let ((_, one), (_, two), (_, other)) =
        (mapped(store, "a").await, mapped(store, "a").await, mapped(store, "b").await);
    assert_eq!(store.publish("a", "hall", &other.id, None, &Guard::Nothing).await.unwrap(), Publication::NoMap);
    assert!(published(store, &one, &Guard::Existing).await.is_none());
    let first = published(store, &one, &Guard::New).await.unwrap();
    assert_eq!((first.version, first.sha256.as_deref(), first.note.as_deref()), (1, Some("0af3"), Some("note")));
    assert!(published(store, &two, &Guard::New).await.is_none());
    let second = published(store, &two, &Guard::Serials(vec![first.serial])).await.unwrap();
    assert!(published(store, &one, &Guard::Serials(vec![first.serial])).await.is_none(), "another was faster");
    assert_eq!(store.place("a", "hall").await.unwrap().as_ref(), Some(&second));
    assert_eq!(store.place_version("a", "hall", 1).await.unwrap().unwrap().map_id, one.id);
    let versions = store.place_versions("a", "hall", None, 10).await.unwrap();
    assert_eq!(versions.iter().map(|place| place.version).collect::<Vec<_>>(), [2, 1]);
    assert_eq!(store.place_versions("a", "hall", Some(2), 10).await.unwrap().len(), 1);
    assert_eq!(store.places("a", None, 10).await.unwrap(), std::slice::from_ref(&second).to_vec());
    let asked = [("a".to_owned(), "hall".to_owned()), ("a".to_owned(), "gone".to_owned())];
    assert_eq!(store.place_serials(&asked).await.unwrap(), [(asked[0].clone(), second.serial)]);
    assert_eq!(
        store.remove_map("a", &one.id).await.unwrap(),
        MapRemoval::Named("hall".into()),
        "it may be rolled back to"
    );
    for tenant in ["b", "nobody"] {
        assert!(store.place(tenant, "hall").await.unwrap().is_none());
    }
    assert_eq!(store.remove_place("a", "hall", &Guard::Serials(vec![first.serial])).await.unwrap(), None);
    assert_eq!(store.remove_place("a", "hall", &Guard::Nothing).await.unwrap(), Some(true));
    assert_eq!(store.remove_place("a", "hall", &Guard::Nothing).await.unwrap(), Some(false));
    assert!(matches!(store.remove_map("a", &one.id).await.unwrap(), MapRemoval::Removed(_)));
    let again = published(store, &two, &Guard::New).await.unwrap();
    assert!(again.version == 1 && again.serial > second.serial, "a robot that waits sees that it is another");
}

async fn publications_at_once_give_versions_without_gap_or_double(store: &dyn Records) {
    let (_, map) = mapped(store, "a").await;
    let publish = || async { published(store, &map, &Guard::Nothing).await.unwrap().version };
    let mut versions = futures::future::join_all((0..8).map(|_| publish())).await;
    versions.sort_unstable();
    assert_eq!(versions, (1..=8).collect::<Vec<i64>>());
    let latest = store.place("a", "hall").await.unwrap().unwrap().serial;
    let guard = Guard::Serials(vec![latest]);
    let guarded = || async { published(store, &map, &guard).await };
    let won = futures::future::join_all((0..8).map(|_| guarded())).await.into_iter().flatten().count();
    assert_eq!(won, 1);
}

async fn keys_are_known_until_and_after_they_are_revoked(store: &dyn Records) {
    assert!(!store.has_keys().await.unwrap());
    let new = NewKey {
        id: "k1".into(),
        tenant: "a".into(),
        name: Some("robot".into()),
        scopes: vec!["read".into(), "submit".into()],
        sha256: [7; 32],
    };
    let made = store.add_key(&new).await.unwrap();
    assert_eq!((made.scopes.len(), made.sha256.len(), made.revoked), (2, 32, None));
    assert_eq!(store.key("k1").await.unwrap(), Some(made));
    assert!(store.key("k2").await.unwrap().is_none());
    assert!(store.revoke_key("k1").await.unwrap() && !store.revoke_key("k2").await.unwrap());
    assert!(store.keys().await.unwrap()[0].revoked.is_some());
    assert!(store.has_keys().await.unwrap(), "a service with a revoked key is not open again");
}

async fn events_are_queued_with_what_makes_them(store: &dyn Records) {
    let hook = |tenant: &str, events: &[&str]| NewWebhook {
        tenant: tenant.into(),
        url: "https://a.example/".into(),
        events: events.iter().map(|event| (*event).to_owned()).collect(),
        secret: "whsec_AAAA".into(),
    };
    let all = store.add_webhook(&hook("a", &["job.successful", "job.dismissed", "place.published"])).await.unwrap();
    store.add_webhook(&hook("a", &["job.failed"])).await.unwrap();
    store.add_webhook(&hook("b", &["job.successful"])).await.unwrap();
    let (job, map) = mapped(store, "a").await;
    let cancelled = accept(store, new_job("a", 0)).await;
    store.cancel("a", &cancelled.id).await.unwrap();
    published(store, &map, &Guard::Nothing).await.unwrap();
    let queued = store.deliveries(&all.id, None, 10).await.unwrap();
    let events: Vec<&str> = queued.iter().map(|delivery| &delivery.event[..]).collect();
    assert_eq!(events, ["place.published", "job.dismissed", "job.successful"]);
    assert_eq!(store.deliveries(&all.id, Some(queued[1].serial), 10).await.unwrap(), queued[2..].to_vec());
    let mut due = store.take_deliveries(10, Duration::from_millis(200)).await.unwrap();
    assert!(store.take_deliveries(10, Duration::from_secs(9)).await.unwrap().is_empty(), "they are held");
    due.sort_by_key(|due| queued.iter().position(|delivery| delivery.id == due.id));
    assert_eq!((due.len(), due[2].attempt, &due[2].url[..]), (3, 1, "https://a.example/"));
    let payload: serde_json::Value = serde_json::from_str(&due[2].payload).unwrap();
    assert_eq!((&payload["type"], &payload["data"]["id"]), (&"job.successful".into(), &job.id.clone().into()));
    assert_eq!(payload["data"]["map_id"], map.id);
    assert!(payload["timestamp"].as_str().unwrap().ends_with('Z'));
    let place: serde_json::Value = serde_json::from_str(&due[0].payload).unwrap();
    assert_eq!((&place["data"]["name"], &place["data"]["version"]), (&"hall".into(), &1.into()));
    assert!(store.settle_delivery(&due[0].id, 1, &Delivered::Yes).await.unwrap());
    assert!(store.settle_delivery(&due[1].id, 1, &Delivered::Never("gone".into())).await.unwrap());
    tokio::time::sleep(Duration::from_millis(300)).await;
    let again = store.take_deliveries(10, Duration::ZERO).await.unwrap();
    assert_eq!((again.len(), again[0].attempt), (1, 2), "its sender died");
    assert!(!store.settle_delivery(&due[2].id, 1, &Delivered::Yes).await.unwrap(), "it comes back late");
    let later = Delivered::NotYet(Duration::from_secs(60), "500".into());
    assert!(store.settle_delivery(&due[2].id, 2, &later).await.unwrap());
    let states: Vec<DeliveryStatus> =
        store.deliveries(&all.id, None, 10).await.unwrap().into_iter().map(|delivery| delivery.status).collect();
    assert_eq!(states, [DeliveryStatus::Delivered, DeliveryStatus::Failed, DeliveryStatus::Pending]);
    assert_eq!(store.webhooks("a", None, 10).await.unwrap().len(), 2);
    assert_eq!(store.webhooks("a", Some(&all.id), 10).await.unwrap().len(), 0);
    assert!(store.webhook("b", &all.id).await.unwrap().is_none());
    assert!(!store.remove_webhook("b", &all.id).await.unwrap());
    assert!(store.remove_webhook("a", &all.id).await.unwrap());
    assert!(store.deliveries(&all.id, None, 10).await.unwrap().is_empty());
}

fn listing(tenant: &str) -> Listing {
    Listing { tenant: tenant.into(), limit: 100, ..Default::default() }
}

/// Runs a case of the suite on a fresh store of each kind.
macro_rules! conformance {
    ($($case:ident),* $(,)?) => {
        mod postgres {
            $(#[test]
            fn $case() {
                tokio::runtime::Runtime::new().unwrap().block_on(async {
                    let store = super::PostgresStore::open(&super::postgres_server::database().await, 8).await.unwrap();
                    super::$case(&store).await;
                });
            })*
        }
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
    a_tenant_runs_no_more_than_it_may,
    holdings_and_quotas_count_what_is_there,
    a_deadline_fails_what_waits_and_what_runs,
    labels_are_replaced_and_found_by,
    versions_of_a_place_follow_one_another,
    publications_at_once_give_versions_without_gap_or_double,
    keys_are_known_until_and_after_they_are_revoked,
    events_are_queued_with_what_makes_them,
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
        let claim = store.claim(&terms("w")).await.unwrap().unwrap();
        assert_eq!((&claim.job.id[..8], claim.request), ("01900000", vec![0u8; 3]));
        assert_eq!(store.claim(&terms("w")).await.unwrap().unwrap().request, vec![3u8; 3]);
        assert!(store.claim(&terms("w")).await.unwrap().is_none());
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
            assert!(store.claim(&terms("w")).await.unwrap().is_some());
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
