//! Places, keys and webhooks.

use std::time::Duration;

use mapfit::jobs::MapRecord;
use mapfit::store::{Delivered, DeliveryStatus, Guard, MapRemoval, NewKey, NewWebhook, Place, Publication, Records};

use crate::{accept, mapped, new_job};

async fn published(store: &dyn Records, map: &MapRecord, guard: &Guard) -> Option<Place> {
    match store.publish("a", "hall", &map.id, Some("note"), guard).await.unwrap() {
        Publication::Published(place) => Some(place),
        Publication::Refused => None,
        Publication::NoMap => panic!("no map"),
    }
}

pub async fn versions_of_a_place_follow_one_another(store: &dyn Records) {
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

pub async fn publications_at_once_give_versions_without_gap_or_double(store: &dyn Records) {
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

pub async fn keys_are_known_until_and_after_they_are_revoked(store: &dyn Records) {
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

pub async fn events_are_queued_with_what_makes_them(store: &dyn Records) {
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
    let mut due = store.take_deliveries(10, Duration::from_millis(200), &[]).await.unwrap();
    assert!(due.iter().all(|delivery| delivery.webhook_id == all.id));
    assert!(store.take_deliveries(10, Duration::from_secs(9), &[]).await.unwrap().is_empty(), "they are held");
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
    assert!(
        store.take_deliveries(10, Duration::ZERO, std::slice::from_ref(&all.id)).await.unwrap().is_empty(),
        "it is busy"
    );
    let again = store.take_deliveries(10, Duration::ZERO, &[]).await.unwrap();
    assert_eq!((again.len(), again[0].attempt), (1, 2), "its sender died");
    assert!(!store.settle_delivery(&due[2].id, 1, &Delivered::Yes).await.unwrap(), "it comes back late");
    let later = Delivered::NotYet(Duration::from_secs(60), "500".into());
    assert!(store.settle_delivery(&due[2].id, 2, &later).await.unwrap());
    let states: Vec<DeliveryStatus> =
        store.deliveries(&all.id, None, 10).await.unwrap().into_iter().map(|delivery| delivery.status).collect();
    assert_eq!(states, [DeliveryStatus::Delivered, DeliveryStatus::Failed, DeliveryStatus::Pending]);
    assert_eq!(store.forget_deliveries(Duration::from_secs(60), 10).await.unwrap(), 0, "they ended just now");
    tokio::time::sleep(Duration::from_millis(10)).await;
    assert_eq!(store.forget_deliveries(Duration::ZERO, 1).await.unwrap(), 1, "no more than is asked for");
    assert_eq!(store.forget_deliveries(Duration::ZERO, 10).await.unwrap(), 1);
    let left = store.deliveries(&all.id, None, 10).await.unwrap();
    assert_eq!((left.len(), left[0].status), (1, DeliveryStatus::Pending), "what waits is not forgotten");
    assert_eq!(store.webhooks("a", None, 10).await.unwrap().len(), 2);
    assert_eq!(store.webhooks("a", Some(&all.id), 10).await.unwrap().len(), 0);
    assert!(store.webhook("b", &all.id).await.unwrap().is_none());
    assert!(!store.remove_webhook("b", &all.id).await.unwrap());
    assert!(store.remove_webhook("a", &all.id).await.unwrap());
    assert!(store.deliveries(&all.id, None, 10).await.unwrap().is_empty());
}
