//! How often a key may ask, and how much a tenant may have.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::JSON;
use crate::keys::key;
use crate::support::{Answer, Server, long, small};

#[test]
fn requests_are_counted_a_key_and_jobs_a_tenant() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 0, &["--rate-limit", "5", "--quota-queued", "2"]);
    let answers: Vec<Answer> = (0..12).map(|_| server.get("/v1/usage")).collect();
    assert!(answers[0].header("ratelimit").starts_with("\"requests\";r="));
    assert_eq!(answers[0].header("ratelimit-policy"), "\"requests\";q=5;w=1");
    let over = answers.iter().find(|answer| answer.status == 429).expect("the limit is five a second");
    over.problem(429);
    assert_eq!(over.header("retry-after"), "1");
    assert_eq!(over.header("ratelimit"), "\"requests\";r=0;t=1");
    assert_eq!(over.header("ratelimit-policy"), "\"requests\";q=5;w=1");
    assert_eq!(server.get("/livez").status, 200, "health is not counted");
    std::thread::sleep(Duration::from_millis(1100));
    let (first, second) = (server.submit(&small(1)), server.submit(&small(2)));
    let over = server.post("/v1/jobs", &small(3));
    assert_eq!(over.problem(429)["type"], "/problems/over-quota");
    assert_eq!(over.header("retry-after"), "30");
    // Of jobs there are none left; of requests, which are told of beside them, there are.
    assert_eq!(over.header("ratelimit-policy"), "\"queued jobs\";q=2");
    assert_eq!(over.header("ratelimit"), "\"queued jobs\";r=0;t=30");
    assert_eq!(over.headers.get_all("ratelimit").iter().count(), 2);
    std::thread::sleep(Duration::from_millis(1100));
    let usage = server.get("/v1/usage").json();
    assert_eq!(usage["queued_jobs"], json!({"used": 2, "limit": 2}));
    // Nothing of it is lost: what was accepted waits.
    for id in [first, second] {
        assert_eq!(server.get(&format!("/v1/jobs/{id}")).json()["status"], "accepted");
    }
}

#[test]
fn each_key_has_a_bucket_of_its_own() {
    let data = tempfile::tempdir().unwrap();
    let [one, two] = [0; 2].map(|_| key(data.path(), "a", "read"));
    let server = Server::start_with(data.path(), 0, &["--rate-limit", "3"]);
    let ask = |key: &str| server.send("GET", "/v1/usage", &[("authorization", key)], None);
    let answers: Vec<Answer> = (0..40).map(|_| ask(&one)).collect();
    assert!(answers.iter().filter(|answer| answer.status == 429).count() >= 5, "three a second");
    let other = ask(&two);
    assert_eq!((other.status, other.header("ratelimit")), (200, "\"requests\";r=2;t=1"));
    server.get("/v1/usage").problem(401);
}

#[test]
fn running_jobs_and_bytes_are_counted_a_tenant() {
    let data = tempfile::tempdir().unwrap();
    let [greedy, modest] = ["a", "b"].map(|tenant| key(data.path(), tenant, "read,submit,admin"));
    let server = Server::start_with(data.path(), 2, &["--quota-running", "1", "--quota-bytes", "1000"]);
    let submit = |key: &str, job: Value| {
        server.send("POST", "/v1/jobs", &[("authorization", key), JSON], Some(job.to_string().as_bytes()))
    };
    let job =
        |key: &str, id: &str| server.send("GET", &format!("/v1/jobs/{id}"), &[("authorization", key)], None).json();
    let id = |answer: Answer| answer.json()["id"].as_str().unwrap().to_owned();
    let [first, second] = [long(1), small(1)].map(|job| id(submit(&greedy, job)));
    let other = id(submit(&modest, small(2)));
    let begun = Instant::now();
    while job(&modest, &other)["status"] != "successful" {
        assert!(begun.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(20));
    }
    // The second solver is free, and no job of this tenant's is taken by it.
    std::thread::sleep(Duration::from_millis(700));
    let states = [&first, &second].map(|id| job(&greedy, id)["status"].clone());
    assert_eq!(states, [json!("running"), json!("accepted")]);

    let over = submit(&modest, small(3));
    assert_eq!(over.problem(429)["type"], "/problems/over-quota");
    assert_eq!(over.header("ratelimit-policy"), "\"bytes of maps\";q=1000");
    assert_eq!(submit(&greedy, small(3)).status, 202, "another tenant has no map yet");
    let map = job(&modest, &other)["map_id"].as_str().unwrap().to_owned();
    let removed = server.send("DELETE", &format!("/v1/maps/{map}"), &[("authorization", &modest)], None);
    assert_eq!(removed.status, 204);
    assert_eq!(submit(&modest, small(3)).status, 202);
}
