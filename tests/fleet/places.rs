//! Places: which map a name has, and how a robot hears of the next.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::{Server, small};
use crate::{JSON, on_each_store, put};

#[test]
fn a_place_has_the_map_that_was_published_last() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let (one, two) = (server.map_of(&small(1)), server.map_of(&small(2)));
    let first = put(&server, "hall", &json!({"map_id": one, "note": "first"}), &[("if-none-match", "*")]);
    assert_eq!((first.status, first.json()["version"].as_i64()), (201, Some(1)));
    let place = first.json();
    assert_eq!((&place["name"], &place["map_id"], &place["note"]), (&json!("hall"), &json!(one), &json!("first")));
    assert_eq!(place["sha256"].as_str().unwrap().len(), 64);
    put(&server, "hall", &json!({"map_id": two}), &[("if-none-match", "*")]).problem(412);
    put(&server, "hall", &json!({"map_id": two}), &[("if-match", "\"p0\"")]).problem(412);
    let second = put(&server, "hall", &json!({"map_id": two}), &[("if-match", first.header("etag"))]);
    assert_eq!((second.status, second.json()["version"].as_i64()), (200, Some(2)));
    put(&server, "hall", &json!({"map_id": one}), &[("if-match", first.header("etag"))]).problem(412);
    put(&server, "Hall", &json!({"map_id": one}), &[]).problem(422);
    assert_eq!(put(&server, "hall", &json!({"map_id": "x"}), &[]).problem(422)["errors"][0]["pointer"], "/map_id");
    put(&server, "hall", &json!({"map_id": one, "x": 1}), &[]).problem(422);

    let got = server.get("/v1/places/hall");
    assert_eq!((got.json()["map_id"].as_str(), got.header("etag")), (Some(&two[..]), second.header("etag")));
    let known = [("if-none-match", second.header("etag"))];
    assert_eq!(server.send("GET", "/v1/places/hall", &known, None).status, 304);
    assert_eq!(server.get("/v1/places").json()["items"][0]["name"], "hall");
    let pages = server.get("/v1/places/hall/versions?limit=1").json();
    assert_eq!(pages["items"][0]["version"], 2);
    let cursor = pages["next_cursor"].as_str().unwrap();
    let rest = server.get(&format!("/v1/places/hall/versions?cursor={cursor}")).json();
    assert_eq!((&rest["items"][0]["version"], &rest["next_cursor"]), (&json!(1), &Value::Null));

    // The redirect is followed here; the map's own address shows in its body.
    assert_eq!(server.get("/v1/places/hall/map").json()["id"], two);
    assert_eq!(server.get("/v1/places/hall/map/coefficients?format=npz").header("content-type"), "application/x-npz");
    server.get("/v1/places/hall/map/%1E%C3%BA%2F..%2F").problem(404);
    server.delete(&format!("/v1/maps/{two}")).problem(409);

    let back = server.post("/v1/places/hall/rollback", &json!({"version": 1}));
    assert_eq!((back.status, &back.json()["version"], &back.json()["map_id"]), (200, &json!(3), &json!(one)));
    assert_eq!(
        server.post("/v1/places/hall/rollback", &json!({"version": 9})).problem(422)["errors"][0]["pointer"],
        "/version"
    );
    server.post("/v1/places/nowhere/rollback", &json!({"version": 1})).problem(404);
    server.delete(&format!("/v1/maps/{two}")).problem(409);
    assert_eq!(server.delete("/v1/places/hall").status, 204);
    server.get("/v1/places/hall").problem(404);
    assert_eq!(server.delete(&format!("/v1/maps/{two}")).status, 204);
}

/// A robot that waits hears of a publication at once, of nothing in time, and of what it does not know right away.
#[test]
fn a_robot_waits_for_the_next_map() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let map = server.map_of(&small(1));
    let tag = put(&server, "hall", &json!({"map_id": map}), &[]).header("etag").to_owned();
    let began = Instant::now();
    assert_eq!(server.send("GET", "/v1/places/hall?wait=1", &[("if-none-match", &tag)], None).status, 304);
    assert!(began.elapsed() >= Duration::from_secs(1));
    assert_eq!(server.get("/v1/places/hall?wait=30").status, 200);
    std::thread::scope(|scope| {
        let waits = scope.spawn(|| {
            let answer = server.send("GET", "/v1/places/hall?wait=30", &[("if-none-match", &tag)], None);
            (answer.json()["version"].as_i64(), Instant::now())
        });
        std::thread::sleep(Duration::from_millis(400));
        put(&server, "hall", &json!({"map_id": map}), &[]);
        let published = Instant::now();
        let (version, heard) = waits.join().unwrap();
        assert_eq!(version, Some(2));
        let late = heard.saturating_duration_since(published);
        println!("heard after {late:?}");
        assert!(late < Duration::from_millis(200), "{late:?}");
    });
    server.get("/v1/places/hall?wait=61").problem(422);
}

/// Publishers at once, and a server that is killed right behind an answer: whatever was answered is there, and no
/// number is missing or there twice.
#[test]
fn what_was_published_outlives_a_kill() {
    on_each_store(published_and_killed);
}

fn published_and_killed(store: &[&str]) {
    const PUBLISHERS: i64 = 4;
    let data = tempfile::tempdir().unwrap();
    let map = Server::start_with(data.path(), 1, store).map_of(&small(1));
    let body = json!({"map_id": map}).to_string();
    let answered = Mutex::new(Vec::new());
    for round in 1..=5 {
        let mut server = Server::start_with(data.path(), 0, store);
        let url = format!("{}/v1/places/hall", server.url);
        std::thread::scope(|scope| {
            for _ in 0..PUBLISHERS {
                scope.spawn(|| {
                    let publish = || ureq::put(&url).header(JSON.0, JSON.1).send(&body);
                    // Until the server is gone.
                    while let Ok(Ok(place)) = publish().map(|mut answer| answer.body_mut().read_json::<Value>()) {
                        answered.lock().unwrap().push(place["version"].as_i64().unwrap());
                    }
                });
            }
            while answered.lock().unwrap().len() < 12 * round {
                std::thread::yield_now();
            }
            server.child.kill().unwrap();
        });
    }
    let server = Server::start_with(data.path(), 0, store);
    let items = server.get("/v1/places/hall/versions?limit=1000").json()["items"].as_array().unwrap().clone();
    let versions: Vec<i64> = items.iter().rev().map(|place| place["version"].as_i64().unwrap()).collect();
    let mut answered = answered.into_inner().unwrap();
    answered.sort_unstable();
    println!("{} publications were answered, {} are there", answered.len(), versions.len());
    assert_eq!(versions, (1..=versions.len() as i64).collect::<Vec<i64>>());
    assert!(answered.windows(2).all(|pair| pair[0] < pair[1]), "no number was given twice");
    assert!(answered.last() <= versions.last(), "what was answered is there");
    // What was on its way when the server was killed may be there, too.
    assert!(versions.len() as i64 <= answered.len() as i64 + 5 * PUBLISHERS);
    assert_eq!(server.get("/v1/places/hall").json()["version"].as_i64(), versions.last().copied());
}
