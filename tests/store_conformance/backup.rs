//! What goes out of a store and in again, and what is kept no longer.

use std::collections::BTreeSet;
use std::time::Duration;

use mapfit::jobs::JobStatus;
use mapfit::store::{Guard, NewJob, Publication, Records, Saved, Submission};

use crate::{accept, listing, mapped, new_job, terms};

pub async fn old_maps_are_found_but_not_what_a_place_names(store: &dyn Records) {
    let ((_, one), (_, two), (_, other)) =
        (mapped(store, "a").await, mapped(store, "a").await, mapped(store, "b").await);
    let publication = store.publish("a", "hall", &one.id, None, &Guard::Nothing).await.unwrap();
    assert!(matches!(publication, Publication::Published(_)));
    tokio::time::sleep(Duration::from_millis(20)).await;
    assert!(store.maps_older_than(Duration::from_secs(60), (0, ""), 10).await.unwrap().is_empty());
    let old = store.maps_older_than(Duration::from_millis(10), (0, ""), 10).await.unwrap();
    let found: Vec<(i64, &str)> = old.iter().map(|(map, _)| (map.created, &map.id[..])).collect();
    assert!(found.is_sorted(), "the oldest first: {found:?}");
    let ids: BTreeSet<&str> = found.iter().map(|(_, id)| *id).collect();
    assert_eq!(ids, BTreeSet::from([&two.id[..], &other.id]), "of every tenant");
    assert!(old.iter().all(|(_, age)| (Duration::from_millis(10)..Duration::from_secs(60)).contains(age)));
    let rest = store.maps_older_than(Duration::ZERO, found[0], 10).await.unwrap();
    assert_eq!(rest.iter().map(|(map, _)| &map.id[..]).collect::<Vec<_>>(), [found[1].1]);
    store.remove_place("a", "hall", &Guard::Nothing).await.unwrap();
    assert_eq!(store.maps_older_than(Duration::ZERO, (0, ""), 10).await.unwrap().len(), 3);
}

pub async fn what_is_saved_is_restored_once(store: &dyn Records) {
    let (job, map) = mapped(store, "a").await;
    store.publish("a", "hall", &map.id, Some("note"), &Guard::Nothing).await.unwrap();
    let keyed = NewJob { idempotency: Some(("k".into(), "body".into())), ..new_job("a", 0) };
    let running = accept(store, keyed.clone()).await;
    store.claim(&terms("w")).await.unwrap().unwrap();
    let mut saved = Vec::new();
    let mut take = |one: Saved| {
        saved.push(one);
        Ok(())
    };
    store.save(&mut take).await.unwrap();
    assert_eq!(saved.len(), 4, "two jobs, a map, a place: {saved:?}");
    assert_eq!(store.restore(&saved).await.unwrap(), 0, "all is there");
    // As they come from another store: under other ids, and another tenant's.
    let text = serde_json::to_string(&saved).unwrap();
    let text = text.replace(&job.id, "job-1").replace(&running.id, "job-2").replace(&map.id, "map-1");
    let mut elsewhere: Vec<Saved> = serde_json::from_str(&text.replace(r#""tenant":"a""#, r#""tenant":"b""#)).unwrap();
    // A version that knew no deadlines, or one that knows more than this.
    for saved in &mut elsewhere {
        if let Saved::Job { job, .. } = saved {
            job.remove("deadline");
            let mut unknown = job.clone();
            unknown.insert("colour".into(), "red".into());
            let newer = Saved::Job { job: unknown, request: Vec::new(), idempotency_keys: Vec::new() };
            assert!(store.restore(&[newer]).await.unwrap_err().to_string().contains("no column colour"));
        }
    }
    assert_eq!(store.restore(&elsewhere).await.unwrap(), 4);
    assert_eq!(store.restore(&elsewhere).await.unwrap(), 0);
    let twin = store.map("b", "map-1").await.unwrap().unwrap();
    let mut expected = store.map("a", &map.id).await.unwrap().unwrap();
    (expected.id, expected.job_id, expected.tenant) = ("map-1".into(), "job-1".into(), "b".into());
    expected.prefix = expected.prefix.replace(&job.id, "job-1");
    assert_eq!(twin, expected);
    let place = store.place("b", "hall").await.unwrap().unwrap();
    assert_eq!((place.version, &place.map_id[..], place.note.as_deref()), (1, "map-1", Some("note")));
    // What ran waits, and is claimed; its request and its key came with it.
    let waits = store.job("b", "job-2").await.unwrap().unwrap();
    assert_eq!((waits.status, waits.attempt), (JobStatus::Accepted, 0));
    let again = NewJob { tenant: "b".into(), ..keyed };
    assert!(matches!(store.submit(again).await.unwrap(), Submission::Repeated(job) if job.id == "job-2"));
    let claim = store.claim(&terms("w")).await.unwrap().unwrap();
    assert_eq!((&claim.job.id[..], &claim.request[..]), ("job-2", &b"request"[..]));
    assert_eq!(
        store.holdings("b").await.unwrap(),
        mapfit::store::Holdings { queued: 0, running: 1, maps: 1, bytes: 1000 }
    );
    assert_eq!(store.jobs(&listing("b")).await.unwrap().len(), 2);
}

/// Tables that are not saved: made anew by triggers, or of one moment.
const LEFT_OUT: [&str; 12] = [
    "_sqlx_migrations",
    "deliveries",
    "holdings",
    "job_labels",
    "lanes",
    "leases",
    "map_labels",
    "parts",
    "probes",
    "served",
    "sqlite_sequence",
    "turns",
];
/// So are these columns.
const COLUMNS_LEFT_OUT: [(&str, &str); 3] = [("jobs", "worker"), ("jobs", "lease_until"), ("place_versions", "serial")];

/// Holds columns of a database, as (table, column), against those that are saved.
fn all_are_saved(columns: &[(String, String)]) {
    let saved = mapfit::store::saved_tables();
    let is_saved =
        |table: &str, column: &str| saved.iter().any(|(name, columns)| *name == table && columns.contains(&column));
    let forgotten: Vec<_> = columns
        .iter()
        .filter(|(table, _)| !LEFT_OUT.contains(&&table[..]))
        .filter(|(table, column)| !COLUMNS_LEFT_OUT.contains(&(&table[..], &column[..])))
        .filter(|(table, column)| !is_saved(table, column))
        .collect();
    assert!(columns.len() > 80 && forgotten.is_empty(), "a backup forgets {forgotten:?}: see src/store/backup.rs");
}

#[test]
fn a_backup_has_every_column_of_every_table() {
    use sqlx::Connection;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("records.sqlite");
    tokio::runtime::Runtime::new().unwrap().block_on(async {
        mapfit::store::SqliteStore::open(&file).await.unwrap();
        let mut sqlite = sqlx::SqliteConnection::connect(&format!("sqlite://{}", file.display())).await.unwrap();
        let columns =
            "SELECT t.name, c.name FROM sqlite_master AS t, pragma_table_info(t.name) AS c WHERE t.type = 'table'";
        all_are_saved(&sqlx::query_as(columns).fetch_all(&mut sqlite).await.unwrap());
        let url = crate::postgres_server::database();
        mapfit::store::PostgresStore::open(&url, 2).await.unwrap();
        let mut postgres = sqlx::PgConnection::connect(&url).await.unwrap();
        let columns =
            "SELECT table_name::text, column_name::text FROM information_schema.columns WHERE table_schema = 'public'";
        all_are_saved(&sqlx::query_as(columns).fetch_all(&mut postgres).await.unwrap());
    });
}
