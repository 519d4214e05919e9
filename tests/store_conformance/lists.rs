//! What is listed: by state, label, box and cursor.

use std::collections::BTreeMap;

use mapfit::jobs::JobStatus;
use mapfit::store::{Listing, MapRemoval, NewJob, Records, Relabelling, Removal};

use crate::{DONE, accept, listing, map_of, mapped, new_job, terms};

pub async fn lists_go_by_status_labels_and_cursor(store: &dyn Records) {
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

pub async fn maps_are_found_by_box_and_label(store: &dyn Records) {
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

pub async fn labels_are_replaced_and_found_by(store: &dyn Records) {
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
