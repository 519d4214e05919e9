//! What every job store promises. One suite, run against each implementation.

mod backup;
mod fleet;
mod lists;
mod parts;
#[path = "../support/postgres.rs"]
mod postgres_server;
mod queue;
mod scale;
mod schema;

use std::collections::BTreeMap;
use std::time::Duration;

use mapfit::fit::{Poses, Weighting, Weights};
use mapfit::jobs::{Job, MapRecord, Progress};
use mapfit::map::FitReport;
use mapfit::spline::Lattice;
use mapfit::store::{Listing, NewJob, PostgresStore, Records, SqliteStore, Submission, Terms};

use backup::*;
use fleet::*;
use lists::*;
use parts::*;
use queue::*;

const LEASE: Duration = Duration::from_millis(400);

fn terms(worker: &str) -> Terms {
    Terms { worker: worker.into(), lease: LEASE, running_a_tenant: i64::MAX }
}

const QUEUED: Progress =
    Progress { percent: 0.0, stage: String::new(), iteration: 0, max_iterations: 5, objective: None, parts: None };
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
        traceparent: None,
        quota: None,
    }
}

async fn accept(store: &dyn Records, job: NewJob) -> Job {
    match store.submit(job).await.unwrap() {
        Submission::Accepted(job) => job,
        other => panic!("{other:?}"),
    }
}

fn report() -> FitReport {
    let weights = Weights {
        eikonal: 1.0,
        eikonal_unit: String::new(),
        eikonal_scale: None,
        smoothing: 0.0,
        observation: String::new(),
        model_sigma: 0.0,
        poses: Poses::Fixed,
    };
    FitReport {
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
        rms: None,
        cut_locus: None,
        active_control_points: None,
    }
}

fn map_of(job: &Job) -> MapRecord {
    MapRecord {
        id: uuid::Uuid::now_v7().to_string(),
        job_id: job.id.clone(),
        tenant: job.tenant.clone(),
        name: None,
        labels: BTreeMap::new(),
        created: 0,
        distance: mapfit::fit::Distance::Signed,
        lattice: Lattice { origin: [0.0, 0.0], resolution: 0.5, cells: [4, 4] },
        fit: report(),
        prefix: format!("attempts/{}/{}", job.id, job.attempt),
        bytes: 1000,
        sha256: Some("0af3".into()),
        parent: None,
        version: 1,
    }
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
                    let store = super::PostgresStore::open(&super::postgres_server::database(), 8).await.unwrap();
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
    who_was_served_longest_ago_is_next,
    a_lost_lease_never_writes,
    a_cancelled_job_takes_no_result,
    a_released_job_is_as_if_never_claimed,
    a_retry_waits_its_delay,
    submissions_at_once_do_not_share_a_fate,
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
    old_maps_are_found_but_not_what_a_place_names,
    what_is_saved_is_restored_once,
    parts_are_done_again_where_their_worker_is_gone,
    parts_end_with_their_attempt,
);
