//! What claims and pages cost where 100,000 jobs are; printed, and held to the bars. Nightly: timed, and long to fill.

use std::time::{Duration, Instant};

use mapfit::jobs::JobStatus;
use mapfit::store::{Listing, PostgresStore, Records, Saved, SqliteStore};
use serde_json::json;

use crate::{accept, new_job, postgres_server, terms};

const JOBS: usize = 100_000;
const CLAIM: Duration = Duration::from_millis(10);
const PAGE: Duration = Duration::from_millis(5);

/// A job as a backup has it: a hundred robots at two sites, most of what ended was successful.
fn saved(k: usize, tenant: &str, status: &str) -> Saved {
    let at = 1_764_000_000_000 + k as i64;
    let id = uuid::Builder::from_unix_timestamp_millis(at as u64, &[0; 10]).into_uuid().to_string();
    let labels = json!({"site": if k.is_multiple_of(10) { "lab" } else { "hq" }, "robot": (k % 10_000).to_string()});
    let progress = json!({"percent": 0.0, "stage": "queued", "iteration": 0, "max_iterations": 9, "objective": null});
    let job = json!({"id": id, "tenant": tenant, "labels": labels.to_string(), "status": status,
                     "progress": progress.to_string(), "created": at, "updated": at});
    let request = json!([{"job_id": id, "request": ""}]);
    serde_json::from_value(json!({"job": {"job": job, "request": request, "idempotency_keys": []}})).unwrap()
}

async fn fill(store: &dyn Records, job: impl Fn(usize) -> Saved) {
    for first in (0..JOBS).step_by(1000) {
        let some: Vec<Saved> = (first..first + 1000).map(&job).collect();
        assert_eq!(store.restore(&some).await.unwrap(), 1000);
    }
}

/// The time within which 99 of 100 are done.
fn p99(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times[times.len() * 99 / 100]
}

async fn claims(store: &dyn Records) {
    fill(store, |k| saved(k, &format!("t{}", k % 1000), "accepted")).await;
    let mut claims = Vec::new();
    let mut tenants = std::collections::BTreeSet::new();
    for _ in 0..1000 {
        let began = Instant::now();
        let claim = store.claim(&terms("w")).await.unwrap().unwrap();
        claims.push(began.elapsed());
        store.cancel(&claim.job.tenant, &claim.job.id).await.unwrap();
        tenants.insert(claim.job.tenant);
    }
    assert_eq!(tenants.len(), 1000, "every tenant has its turn before any has another");
    let late = accept(store, new_job("late", 0)).await;
    let next = store.claim(&terms("w")).await.unwrap().unwrap();
    assert_eq!(next.job.id, late.id, "who has one job waits for those that run, and no others");
    let claim = p99(claims);
    println!("99 % of claims within {claim:.1?}");
    assert!(claim <= CLAIM);
}

async fn pages(store: &dyn Records) {
    let status = |k: usize| match k % 100 {
        0..90 => "successful",
        90..95 => "failed",
        95..99 => "dismissed",
        _ => "accepted",
    };
    fill(store, |k| saved(k, "default", status(k / 7))).await;
    let label = |key: &str, value: String| vec![(key.to_owned(), value)];
    let mut asked = vec![(None, vec![]), (None, label("site", "hq".into())), (None, label("site", "lab".into()))];
    asked.extend(JobStatus::ALL.map(|status| (Some(status), vec![])));
    asked.extend((0..50).map(|k| (None, label("robot", (k * 199).to_string()))));
    asked.push((Some(JobStatus::Failed), label("robot", "77".into())));
    for (status, labels) in asked {
        let listing = Listing { tenant: "default".into(), status, labels, limit: 51, ..Listing::default() };
        let mut times = Vec::new();
        for _ in 0..20 {
            let began = Instant::now();
            store.jobs(&listing).await.unwrap();
            times.push(began.elapsed());
        }
        times.sort_unstable();
        let page = times[times.len() / 2];
        if listing.labels.first().is_none_or(|(key, _)| key == "site") {
            println!("a page of {status:?} {:?}: {page:.1?}", listing.labels);
        }
        assert!(page <= PAGE, "{listing:?}: {page:?}");
    }
}

macro_rules! at_scale {
    ($($name:ident: $case:ident on $store:ident),+) => {
        $(#[test]
        #[ignore = "nightly: cargo test --release --test store_conformance -- --ignored --nocapture"]
        fn $name() {
            let folder = tempfile::tempdir().unwrap();
            tokio::runtime::Runtime::new().unwrap().block_on(async {
                $case(&$store(folder.path()).await).await;
            });
        })+
    };
}

async fn sqlite(folder: &std::path::Path) -> SqliteStore {
    SqliteStore::open(&folder.join("jobs.sqlite")).await.unwrap()
}

async fn postgres(_: &std::path::Path) -> PostgresStore {
    PostgresStore::open(&postgres_server::database(), 8).await.unwrap()
}

at_scale!(
    claims_of_a_hundred_thousand_jobs_in_sqlite: claims on sqlite,
    claims_of_a_hundred_thousand_jobs_in_postgres: claims on postgres,
    pages_of_a_hundred_thousand_jobs_in_sqlite: pages on sqlite,
    pages_of_a_hundred_thousand_jobs_in_postgres: pages on postgres
);
