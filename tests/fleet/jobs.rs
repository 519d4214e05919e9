//! Dry runs, second tries, other labels, deadlines.

use serde_json::{Value, json};

use crate::JSON;
use crate::support::{Server, long, small};

#[test]
fn a_dry_run_says_what_a_map_would_be_and_keeps_nothing() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let dry = server.post("/v1/jobs?dry_run=true", &small(1));
    assert_eq!(dry.status, 200);
    let dry = dry.json();
    assert_eq!(server.get("/v1/jobs").json()["items"], json!([]));
    let map = server.map_of(&small(1));
    let map = server.get(&format!("/v1/maps/{map}")).json();
    assert_eq!(dry["lattice"], map["lattice"]);
    assert!(dry["control_points"].as_u64().unwrap() > 0 && dry["returns"].as_u64().unwrap() > 0);
    assert!(dry["estimate"]["seconds"].as_f64().unwrap() > 0.0 && dry["estimate"]["bytes"].as_u64().unwrap() > 0);
    let mut bad = small(1);
    bad["map"]["resolution"] = json!(-1);
    assert_eq!(server.post("/v1/jobs?dry_run=true", &bad).problem(422)["errors"][0]["pointer"], "/map/resolution");
    server.post("/v1/jobs?dry_run=maybe", &small(1)).problem(422);
}

#[test]
fn an_ended_job_is_tried_again_and_relabelled() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let mut job = small(1);
    job["labels"] = json!({"site": "hq"});
    let id = server.submit(&job);
    let first = server.wait(&id);
    let again = server.post(&format!("/v1/jobs/{id}/retry"), &json!({}));
    assert_eq!(
        (again.status, &again.json()["retry_of"], &again.json()["labels"]),
        (202, &json!(id), &json!({"site": "hq"}))
    );
    assert_eq!(again.header("location"), format!("/v1/jobs/{}", again.json()["id"].as_str().unwrap()));
    let second = server.wait(again.json()["id"].as_str().unwrap());
    let coefficients =
        |job: &Value| server.get(&format!("/v1/maps/{}/coefficients", job["map_id"].as_str().unwrap())).body;
    assert_eq!(coefficients(&first), coefficients(&second));
    assert_eq!((&first["retry_of"], &first["parts"]), (&Value::Null, &Value::Null));

    let map = format!("/v1/maps/{}", first["map_id"].as_str().unwrap());
    let tag = server.get(&map).header("etag").to_owned();
    let patch = |path: &str, body: &Value| server.send("PATCH", path, &[JSON], Some(body.to_string().as_bytes()));
    let changed = patch(&map, &json!({"name": "hall", "labels": {"site": "lab"}}));
    assert_eq!((&changed.json()["name"], &changed.json()["labels"]), (&json!("hall"), &json!({"site": "lab"})));
    let got = server.send("GET", &map, &[("if-none-match", &tag)], None);
    assert_eq!((got.status, &got.json()["name"]), (200, &json!("hall")), "its tag has changed");
    assert_eq!(server.get("/v1/maps?label=site:lab").json()["items"].as_array().unwrap().len(), 1);
    assert_eq!(patch(&format!("/v1/jobs/{id}"), &json!({"labels": {}})).json()["labels"], json!({}));
    assert_eq!(patch(&map, &json!({"labels": {"a": 1}})).problem(422)["errors"][0]["pointer"], "/labels/a");
    assert_eq!(patch(&map, &json!({"distance": "sdf"})).problem(422)["errors"][0]["pointer"], "/distance");
    patch("/v1/maps/x", &json!({})).problem(404);
    server.post("/v1/jobs/x/retry", &json!({})).problem(404);
}

#[test]
fn a_deadline_or_a_time_limit_ends_a_job() {
    let data = tempfile::tempdir().unwrap();
    {
        let server = Server::start(data.path(), 0);
        let mut late = small(1);
        late["deadline_seconds"] = json!(0.5);
        let id = server.submit(&late);
        server.post(&format!("/v1/jobs/{id}/retry"), &json!({})).problem(409);
        let job = server.wait(&id);
        assert_eq!((&job["status"], &job["problem"]["type"]), (&json!("failed"), &json!("/problems/deadline-passed")));
        late["deadline_seconds"] = json!(0);
        assert_eq!(server.post("/v1/jobs", &late).problem(422)["errors"][0]["pointer"], "/deadline_seconds");
    }
    let server = Server::start_with(data.path(), 1, &["--job-seconds", "1"]);
    let job = server.wait(&server.submit(&long(1)));
    assert_eq!((&job["status"], &job["problem"]["type"]), (&json!("failed"), &json!("/problems/job-too-long")));
}
