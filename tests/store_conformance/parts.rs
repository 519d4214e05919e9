//! Parts of jobs: leases in small.

use mapfit::store::{Hold, Pass, Standing};

use super::*;

/// A job that runs, and a pass of it with three parts on offer.
async fn offered(store: &dyn Records) -> (Job, Pass) {
    accept(store, new_job("a", 0)).await;
    let job = store.claim(&terms("w")).await.unwrap().unwrap().job;
    let pass = Pass { job_id: job.id.clone(), attempt: job.attempt, prefix: format!("attempts/{}/1-x", job.id) };
    assert!(store.offer_parts(&pass, 3).await.unwrap());
    (job, pass)
}

async fn standings(store: &dyn Records, pass: &Pass) -> Vec<(i64, Standing)> {
    let parts = store.parts_of(&pass.prefix).await.unwrap();
    parts.into_iter().map(|(part, standing)| (part.number, standing)).collect()
}

pub async fn parts_are_done_again_where_their_worker_is_gone(store: &dyn Records) {
    use Standing::{Delivered, Free, Taken};
    assert_eq!(store.take_part("w", LEASE).await.unwrap(), None);
    let (_, pass) = offered(store).await;
    // The last first, each once; the attempt keeps what nobody has.
    let last = store.take_part("w", LEASE).await.unwrap().unwrap();
    let second = store.take_part("v", LEASE).await.unwrap().unwrap();
    assert_eq!([(last.number, last.claim), (second.number, second.claim)], [(2, 1), (1, 1)]);
    assert_eq!(standings(store, &pass).await, [(0, Free), (1, Taken), (2, Taken)]);
    assert!(!store.keep_part(&pass.prefix, 2).await.unwrap());
    assert!(store.keep_part(&pass.prefix, 0).await.unwrap());
    assert!(!store.keep_part(&pass.prefix, 0).await.unwrap());
    assert_eq!(store.take_part("w", LEASE).await.unwrap(), None);

    // One gives back, one is silent: both parts are anyone's, and late words about them nobody's.
    assert_eq!(store.hold_part(&second, Duration::ZERO).await.unwrap(), Hold::Waits);
    assert_eq!(standings(store, &pass).await, [(1, Free), (2, Taken)]);
    tokio::time::sleep(LEASE + Duration::from_millis(50)).await;
    let again = store.take_part("v", Duration::from_secs(60)).await.unwrap().unwrap();
    assert_eq!((again.number, again.claim), (2, 2));
    assert_ne!(again.files(), last.files());
    assert_eq!(store.hold_part(&last, LEASE).await.unwrap(), Hold::Lost);
    assert!(!store.send_part(&last).await.unwrap() && !store.deliver_part(&last).await.unwrap());

    // What two could not do is left to the attempt.
    let third = store.take_part("v", LEASE).await.unwrap().unwrap();
    assert_eq!((third.number, third.claim), (1, 2));
    assert_eq!(store.hold_part(&third, Duration::ZERO).await.unwrap(), Hold::Waits);
    assert_eq!(store.take_part("v", LEASE).await.unwrap(), None);

    assert_eq!(store.hold_part(&again, LEASE).await.unwrap(), Hold::Waits);
    assert!(store.send_part(&again).await.unwrap());
    assert_eq!(store.hold_part(&again, LEASE).await.unwrap(), Hold::Sent);
    assert!(store.deliver_part(&again).await.unwrap());
    assert_eq!(standings(store, &pass).await, [(1, Free), (2, Delivered)]);
    assert_eq!(store.hold_part(&again, LEASE).await.unwrap(), Hold::Lost);
    assert!(!store.deliver_part(&again).await.unwrap() && !store.keep_part(&pass.prefix, 2).await.unwrap());
    store.withdraw_parts(&pass.prefix).await.unwrap();
    assert_eq!(standings(store, &pass).await, []);
    assert_eq!(store.take_part("w", LEASE).await.unwrap(), None);
}

pub async fn parts_end_with_their_attempt(store: &dyn Records) {
    let (job, pass) = offered(store).await;
    let taken = store.take_part("v", LEASE).await.unwrap().unwrap();
    assert!(store.retry(&job.id, job.attempt, Duration::ZERO, "again", &QUEUED).await.unwrap());
    assert_eq!(store.take_part("v", LEASE).await.unwrap(), None);
    assert_eq!(store.hold_part(&taken, LEASE).await.unwrap(), Hold::Lost);
    assert!(!store.deliver_part(&taken).await.unwrap());
    assert!(!store.offer_parts(&pass, 2).await.unwrap());

    // The next attempt's take the place of what is left, and one that is late changes nothing of them.
    let next = store.claim(&terms("w")).await.unwrap().unwrap().job;
    let own = Pass { attempt: next.attempt, prefix: format!("attempts/{}/2-x", job.id), ..pass.clone() };
    assert!(store.offer_parts(&own, 1).await.unwrap());
    assert_eq!(standings(store, &pass).await, []);
    assert!(!store.offer_parts(&pass, 3).await.unwrap());
    assert_eq!(standings(store, &own).await, [(0, Standing::Free)]);
    assert_eq!(store.take_part("v", LEASE).await.unwrap().map(|part| part.prefix), Some(own.prefix));
}
