//! kill -9, SIGTERM and SIGSTOP in the middle of a fit: nothing accepted is lost, no finished map changes.

#[path = "support/postgres.rs"]
mod postgres_server;
mod support;

use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
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

/// A process that works and does not serve, with its metrics' address; killed when it is dropped.
struct Worker(Child, String);

impl Worker {
    fn start(data: &Path, arguments: &[&str]) -> Self {
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let metrics = format!("127.0.0.1:{port}");
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command.args(["worker", "--workers", "1", "--log", "error", "--metrics-listen", &metrics]).args(arguments);
        Self(command.arg("--data").arg(data).spawn().unwrap(), format!("http://{metrics}/metrics"))
    }

    fn signal(&self, signal: &str) {
        assert!(Command::new("kill").args([signal, &self.0.id().to_string()]).status().unwrap().success());
    }

    fn stands_still(&self) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.0.id())).unwrap();
        stat.rsplit(')').next().unwrap().trim_start().starts_with('T')
    }

    /// Stops it, but not while it holds the database, which SQLite has one of for all: then everybody would stand still.
    fn freeze(&self, server: &Server) {
        for _ in 0..5 {
            self.signal("-STOP");
            // Readiness is believed for a second.
            std::thread::sleep(Duration::from_millis(1200));
            if server.get("/readyz").status == 200 {
                assert!(self.stands_still());
                return;
            }
            self.signal("-CONT");
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("it holds the database whenever it is stopped");
    }

    fn counted(&self, metric: &str) -> f64 {
        let text = ureq::get(&self.1).call().unwrap().body_mut().read_to_string().unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix(metric)?.strip_prefix(' '));
        line.unwrap_or_else(|| panic!("{metric} in {text}")).parse().unwrap()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Every file below a folder, with its bytes.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| match path.is_dir() {
            true => files(&path),
            false => vec![(path.clone(), std::fs::read(path).unwrap_or_default())],
        })
        .collect()
}

fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A worker stands still in the middle of a fit until its lease has lapsed, and another has finished the job. When it
/// goes on it finds that out, and writes nothing.
fn a_frozen_worker_writes_nothing(database: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let shared: Vec<&str> =
        ["--lease-seconds", "1", "--sweep-seconds", "1"].into_iter().chain(database.iter().copied()).collect();
    let server = Server::start_with(folder.path(), 0, &shared);
    let first = Worker::start(folder.path(), &shared);
    let mut request = long(2);
    request["map"]["resolution"] = 0.08.into();
    let id = server.submit(&request);
    let job = || -> Value { server.get(&format!("/v1/jobs/{id}")).json() };
    until("it does not fit", || job()["progress"]["iteration"].as_i64() > Some(0));
    first.freeze(&server);
    // Where standing still took long to come about, its lease has lapsed by now.
    let stopped = job();
    assert!(["running", "accepted"].contains(&stopped["status"].as_str().unwrap()), "it was done: {stopped}");

    let second = Worker::start(folder.path(), &shared);
    let done = server.wait(&id);
    assert_eq!((&done["status"], &done["attempt"]), (&json!("successful"), &json!(2)), "{done}");
    drop(second);
    let parts = ["", "/coefficients?format=npz", "/covariance?form=sparse", "/poses"];
    let map = done["map_id"].as_str().unwrap();
    let seen = |server: &Server| parts.map(|part| server.get(&format!("/v1/maps/{map}{part}")).body);
    let (maps, kept) = (seen(&server), files(&folder.path().join("artifacts/attempts")));
    assert!(first.stands_still() && job() == done);

    first.signal("-CONT");
    until("it does not notice", || first.counted("mapfit_leases_lost_total") >= 1.0);
    until("it does not give up", || first.counted("mapfit_attempts_total{outcome=\"stopped\"}") == 1.0);
    assert_eq!(first.counted("mapfit_attempts_total{outcome=\"successful\"}"), 0.0);
    let own = |kept: &[(PathBuf, Vec<u8>)]| kept.iter().filter(|(path, _)| path.ends_with("map.npz")).count();
    until("more than its map's file is left", || own(&files(&folder.path().join("artifacts/attempts"))) == 1);
    assert!(files(&folder.path().join("artifacts/attempts")) == kept, "the file has changed");
    assert_eq!(job(), done);
    assert_eq!(server.get("/v1/maps").json()["items"].as_array().unwrap().len(), 1);
    let fresh = Server::start_with(folder.path(), 0, &shared);
    assert!(seen(&server) == maps && seen(&fresh) == maps, "the map has changed");
}

#[test]
fn a_worker_that_stood_still_writes_nothing_into_sqlite() {
    a_frozen_worker_writes_nothing(&[]);
}

#[test]
fn a_worker_that_stood_still_writes_nothing_into_postgres() {
    let url = postgres_server::database();
    a_frozen_worker_writes_nothing(&["--database-url", &url]);
}
