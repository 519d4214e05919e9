//! kill -9 and SIGTERM in the middle of a fit: nothing accepted is lost, no finished map changes.

mod support;

use std::time::{Duration, Instant};

use serde_json::json;
use support::{Server, long, small};

fn until_fitting(server: &Server, id: &str) {
    let begun = Instant::now();
    while server.get(&format!("/v1/jobs/{id}")).json()["progress"]["stage"] != "fitting" {
        assert!(begun.elapsed() < Duration::from_secs(60), "the job does not begin");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_killed_server_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Server::start(folder.path(), 1);
    let finished = server.map_of(&small(1));
    let arrays = |server: &Server| {
        ["", "/coefficients", "/covariance", "/contours?sigma_band=2"]
            .map(|p| server.get(&format!("/v1/maps/{finished}{p}")).body)
    };
    let before = arrays(&server);
    let running = server.submit(&long(2));
    let waiting: Vec<String> = (3..6).map(|seed| server.submit(&small(seed))).collect();
    until_fitting(&server, &running);
    server.child.kill().unwrap();
    server.child.wait().unwrap();

    let server = Server::start(folder.path(), 1);
    assert!(arrays(&server) == before, "a finished map changed");
    let job = server.wait(&running);
    assert_eq!((&job["status"], &job["attempt"]), (&json!("successful"), &json!(2)), "{job}");
    for id in &waiting {
        assert_eq!(server.wait(id)["status"], "successful");
    }
    assert_eq!(server.get("/v1/maps?limit=100").json()["items"].as_array().unwrap().len(), 5);
}

#[test]
fn sigterm_hands_a_running_job_back_unharmed() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Server::start(folder.path(), 1);
    let mut request = long(2);
    request["map"]["resolution"] = 0.03.into();
    let id = server.submit(&request);
    until_fitting(&server, &id);
    server.signal("-TERM");
    let begun = Instant::now();
    let status = server.child.wait().unwrap();
    assert!(status.success(), "{status}");
    assert!(begun.elapsed() < Duration::from_secs(20));

    let server = Server::start(folder.path(), 0);
    let job = server.get(&format!("/v1/jobs/{id}")).json();
    assert_eq!((&job["status"], &job["attempt"]), (&json!("accepted"), &json!(0)), "{job}");
}
