//! The queue: turns, leases, second attempts, quotas, deadlines.

use std::time::Duration;

use mapfit::jobs::lifecycle::{MAX_ATTEMPTS, after_lapse};
use mapfit::jobs::{JobStatus, ProblemReport, Progress};
use mapfit::store::{
    Cancellation, Holdings, LIGHT, MapRemoval, NewJob, Quota, Records, Submission, Terms, Total, Written,
};

use crate::{DONE, LEASE, QUEUED, accept, listing, map_of, mapped, new_job, terms};

pub async fn claims_go_by_priority_then_fairness_then_age(store: &dyn Records) {
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

/// One worker, so that nobody has a job running when it claims.
pub async fn who_was_served_longest_ago_is_next(store: &dyn Records) {
    let next = async || {
        let job = store.claim(&terms("w")).await.unwrap().unwrap().job;
        store.cancel(&job.tenant, &job.id).await.unwrap();
        job.tenant
    };
    for tenant in ["a", "a", "a", "a", "b"] {
        accept(store, new_job(tenant, 0)).await;
    }
    assert_eq!([next().await, next().await], ["a", "b"], "b came last, and waited for one job");
    assert_eq!(next().await, "a");
    accept(store, new_job("late", 0)).await;
    assert_eq!(next().await, "late");
    // Who sends one job after another is no newcomer each time, and what is urgent is a turn like any other.
    accept(store, new_job("late", 0)).await;
    accept(store, new_job("b", 5)).await;
    accept(store, new_job("b", 0)).await;
    assert_eq!([next().await, next().await, next().await, next().await], ["b", "a", "late", "b"]);
}

pub async fn a_lost_lease_never_writes(store: &dyn Records) {
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
    let written = |prefix: &str, attempt| Written { prefix: prefix.into(), job_id: job.id.clone(), attempt };
    let own = written("attempts/x/2", 2);
    assert_eq!(store.owned(&[written("attempts/x/1", 1), own.clone()]).await.unwrap(), [false, true]);
    let map = map_of(&second);
    assert!(store.succeed(2, &map, &DONE).await.unwrap());
    assert!(!store.succeed(2, &map_of(&second), &DONE).await.unwrap(), "a job succeeds once");
    let done = store.job("a", &job.id).await.unwrap().unwrap();
    assert_eq!((done.status, done.map_id.as_deref()), (JobStatus::Successful, Some(map.id.as_str())));
    assert_eq!(done.progress.max_iterations, 5);
    let asked = [written(&map.prefix, 2), own, Written { job_id: String::new(), ..written(&map.prefix, 0) }];
    assert_eq!(store.owned(&asked).await.unwrap(), [true, false, true], "once it has ended, what its map names");
    assert!(store.owned(&[]).await.unwrap().is_empty());
}

pub async fn a_cancelled_job_takes_no_result(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    assert_eq!(store.cancel("b", &job.id).await.unwrap(), Cancellation::Unknown, "another tenant's job is unknown");
    let running = store.claim(&terms("w")).await.unwrap().unwrap().job;
    assert!(matches!(store.cancel("a", &job.id).await.unwrap(), Cancellation::Dismissed(_)));
    assert!(!store.succeed(running.attempt, &map_of(&running), &DONE).await.unwrap());
    assert!(matches!(store.cancel("a", &job.id).await.unwrap(), Cancellation::AlreadyEnded(_)));
    assert!(store.claim(&terms("w")).await.unwrap().is_none());
}

pub async fn a_released_job_is_as_if_never_claimed(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    store.claim(&terms("w")).await.unwrap().unwrap();
    assert!(store.release(&job.id, 1, &QUEUED).await.unwrap());
    let back = store.job("a", &job.id).await.unwrap().unwrap();
    assert_eq!((back.status, back.attempt), (JobStatus::Accepted, 0));
    // Its tenant has not had its turn.
    accept(store, new_job("b", 0)).await;
    assert_eq!(store.claim(&terms("w")).await.unwrap().unwrap().job.id, job.id);
    assert!(store.release(&job.id, 1, &QUEUED).await.unwrap());
    assert!(!store.retry(&job.id, 1, Duration::ZERO, "late", &QUEUED).await.unwrap());
}

pub async fn a_retry_waits_its_delay(store: &dyn Records) {
    let job = accept(store, new_job("a", 0)).await;
    store.claim(&terms("w")).await.unwrap().unwrap();
    assert!(store.retry(&job.id, 1, Duration::from_millis(300), "disk", &QUEUED).await.unwrap());
    assert!(store.claim(&terms("w")).await.unwrap().is_none());
    tokio::time::sleep(Duration::from_millis(400)).await;
    assert_eq!(store.claim(&terms("w")).await.unwrap().unwrap().job.attempt, 2);
}

pub async fn idempotency_keys_belong_to_a_tenant(store: &dyn Records) {
    let keyed =
        |tenant: &str, body: &str| NewJob { idempotency: Some(("k".into(), body.into())), ..new_job(tenant, 0) };
    let first = accept(store, keyed("a", "one")).await;
    let Submission::Repeated(again) = store.submit(keyed("a", "one")).await.unwrap() else { panic!() };
    assert_eq!(again.id, first.id);
    assert_eq!(store.submit(keyed("a", "two")).await.unwrap(), Submission::KeyReused);
    accept(store, keyed("b", "two")).await;
}

pub async fn lapsed_leases_cost_attempts_until_the_job_fails(store: &dyn Records) {
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

pub async fn two_claimers_never_get_the_same_job(store: &dyn Records) {
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

pub async fn a_tenant_runs_no_more_than_it_may(store: &dyn Records) {
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

pub async fn holdings_and_quotas_count_what_is_there(store: &dyn Records) {
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
    let all = store.totals().await.unwrap();
    assert_eq!((all.light.held.queued, all.light.held.maps, all.light.oldest.is_some()), (2, 1, true));
    assert_eq!(all.heavy, Total::default());
    for _ in 0..=LIGHT {
        accept(store, new_job("c", 0)).await;
    }
    let burst = store.totals().await.unwrap();
    assert_eq!((burst.light.held, burst.heavy.held.queued), (all.light.held, LIGHT + 1));
    assert!(burst.light.oldest >= all.light.oldest && burst.heavy.oldest.unwrap() <= burst.light.oldest.unwrap());
    assert!(matches!(store.remove_map("a", &map.id).await.unwrap(), MapRemoval::Removed(_)));
    assert_eq!(store.holdings("a").await.unwrap().bytes, 0);
    assert_eq!(store.holdings("nobody").await.unwrap(), Holdings::default());
}

pub async fn a_deadline_fails_what_waits_and_what_runs(store: &dyn Records) {
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

/// Submissions that come at once may be committed together; one that cannot be kept fails by itself.
pub async fn submissions_at_once_do_not_share_a_fate(store: &dyn Records) {
    let of = |k: usize| match k {
        // A time that no column holds.
        k if k % 7 == 3 => NewJob { deadline_seconds: Some(f64::MAX), ..new_job("a", 0) },
        k if k % 7 == 5 => NewJob { idempotency: Some(("key".into(), "digest".into())), ..new_job("a", 0) },
        _ => new_job("a", 0),
    };
    let outcomes = futures::future::join_all((0..70).map(|k| store.submit(of(k)))).await;
    let mut keyed = std::collections::BTreeSet::new();
    let mut accepted = 0;
    for (k, outcome) in outcomes.into_iter().enumerate() {
        match (k % 7, outcome) {
            (3, outcome) => assert!(outcome.is_err(), "{outcome:?}"),
            (5, Ok(Submission::Accepted(job) | Submission::Repeated(job))) => drop(keyed.insert(job.id)),
            (_, Ok(Submission::Accepted(job))) => {
                accepted += 1;
                assert_eq!(store.job("a", &job.id).await.unwrap(), Some(job));
            }
            (_, outcome) => panic!("{outcome:?}"),
        }
    }
    assert_eq!((accepted, keyed.len()), (50, 1));
    assert_eq!(store.jobs(&listing("a")).await.unwrap().len(), 51);
}
