//! Maps with more control points in use than one fit may have: fitted in parts, by whichever solvers have time, and the
//! same maps to the last bit.

#[path = "support/postgres.rs"]
mod postgres_server;
mod support;

use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::OnceLock;
use std::time::Duration;

use mapfit::scan::Noise;
use serde_json::{Value, json};
use support::{Server, small};

/// A room as a map of some thousand control points.
fn fine(distance: &str) -> Value {
    let mut job = small(1);
    job["map"] = json!({"distance": distance, "resolution": 0.14});
    job
}

/// The job at its end, and what is worth comparing of its map.
fn fitted(server: &Server, job: &Value) -> (Value, Vec<Vec<u8>>) {
    let accepted = server.post("/v1/jobs", job);
    assert_eq!(accepted.status, 202, "{}", accepted.json());
    let ended = server.wait(accepted.json()["id"].as_str().unwrap());
    assert_eq!(ended["status"], "successful", "{ended}");
    let map = format!("/v1/maps/{}", ended["map_id"].as_str().unwrap());
    let all = ["coefficients", "covariance?form=sparse", "covariance?form=sparse&kind=posterior"];
    let bytes =
        all.map(|what| server.send("GET", &format!("{map}/{what}"), &[("accept", "application/x-npz")], None).body);
    (ended, bytes.into())
}

#[test]
fn a_map_too_large_for_one_fit_is_fitted_in_parts_and_is_the_same() {
    let (whole_data, parts_data) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let whole = Server::start(whole_data.path(), 1);
    let in_parts = Server::start_with(parts_data.path(), 3, &["--max-control-points", "600"]);
    for distance in ["sdf", "vdf"] {
        let (undivided, expected) = fitted(&whole, &fine(distance));
        assert_eq!(undivided["parts"], Value::Null);
        let accepted = in_parts.post("/v1/jobs", &fine(distance)).json();
        let total = accepted["parts"]["total"].as_u64().unwrap();
        assert!(total > 1, "{accepted}");
        assert_eq!(accepted["parts"], json!({"total": total, "done": 0, "running": 0}));
        let (divided, bytes) = fitted(&in_parts, &fine(distance));
        let parts = &divided["parts"];
        assert!(parts["total"].as_u64().unwrap() > 1, "{divided}");
        assert_eq!((&parts["done"], &parts["running"]), (&parts["total"], &json!(0)), "{divided}");
        assert!(divided["progress"].get("parts").is_none(), "told once, beside the progress");
        assert!(bytes == expected, "the {distance} of parts differs from the undivided one");
    }
}

#[test]
fn updates_and_joins_of_large_maps_are_in_parts_too() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 1, &["--max-control-points", "600"]);
    let (first, _) = fitted(&server, &fine("vdf"));
    let id = first["map_id"].as_str().unwrap();
    let more = small(2);
    let update = json!({"scans": more["scans"], "noise": more["noise"]});
    let updated = server.post(&format!("/v1/maps/{id}/updates"), &update);
    assert_eq!(updated.status, 202, "{}", updated.json());
    assert!(updated.json()["parts"]["total"].as_u64().unwrap() > 1);
    let join = |tiling: &str| json!({"maps": [{"id": id}], "map": {"resolution": 0.14, "tiling": tiling}});
    let joined = server.post("/v1/joins", &join("auto"));
    assert_eq!(joined.status, 202, "{}", joined.json());
    assert!(joined.json()["parts"]["total"].as_u64().unwrap() > 1);
    let problem = server.post("/v1/joins", &join("none")).problem(422);
    assert_eq!(problem["errors"][0]["pointer"], "/map/resolution");
    for job in [updated, joined] {
        let ended = server.wait(job.json()["id"].as_str().unwrap());
        assert_eq!(ended["status"], "successful", "{ended}");
    }
}

#[test]
fn a_job_in_parts_survives_the_death_of_its_service() {
    let data = tempfile::tempdir().unwrap();
    let flags = ["--max-control-points", "600", "--lease-seconds", "1"];
    let server = Server::start_with(data.path(), 2, &flags);
    let (_, expected) = fitted(&server, &fine("sdf"));
    let id = server.post("/v1/jobs", &fine("sdf")).json()["id"].as_str().unwrap().to_owned();
    while server.get(&format!("/v1/jobs/{id}")).json()["status"] == "accepted" {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    drop(server);
    let server = Server::start_with(data.path(), 2, &flags);
    let ended = server.wait(&id);
    assert_eq!(ended["status"], "successful", "{ended}");
    let map = format!("/v1/maps/{}/coefficients", ended["map_id"].as_str().unwrap());
    let coefficients = server.send("GET", &map, &[("accept", "application/x-npz")], None).body;
    assert!(coefficients == expected[0]);
}

/// A process that works and does not serve; killed when it is dropped.
struct Worker {
    process: Child,
    log: PathBuf,
}

impl Worker {
    fn start(data: &Path, log: PathBuf, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command.args(["worker", "--workers", "1", "--log", "info", "--lease-seconds", "1"]).args(arguments);
        command.arg("--data").arg(data).stderr(std::fs::File::create(&log).unwrap());
        Self { process: command.spawn().unwrap(), log }
    }

    /// How often it said so.
    fn said(&self, what: &str) -> usize {
        std::fs::read_to_string(&self.log).unwrap().matches(what).count()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Files of parcels and answers under a folder.
fn letters(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let paths = entries.map(|entry| entry.unwrap().path());
    paths
        .map(|path| match path.is_dir() {
            true => letters(&path),
            false => usize::from(path.to_string_lossy().ends_with(".npz") && !path.ends_with("map.npz")),
        })
        .sum()
}

/// Three workers, of which one has the job and the others help; then one of those is killed with a part in its hands.
fn helped(store: &[&str]) {
    static UNDIVIDED: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    let job = building(4);
    let expected = UNDIVIDED.get_or_init(|| {
        let data = tempfile::tempdir().unwrap();
        fitted(&Server::start(data.path(), 1), &job).1
    });
    let data = tempfile::tempdir().unwrap();
    let flags: Vec<&str> = store.iter().copied().chain(["--max-control-points", "600"]).collect();
    let server = Server::start_with(data.path(), 0, &flags);
    let start = |k: usize| Worker::start(data.path(), data.path().join(format!("worker-{k}.log")), store);
    let mut workers: Vec<Worker> = (0..3).map(start).collect();
    let (ended, bytes) = fitted(&server, &job);
    assert_eq!(ended["attempt"], 1, "{ended}");
    assert!(bytes == *expected, "the map of several workers differs from one worker's");
    let done: Vec<usize> = workers.iter().map(|worker| worker.said("a part is done")).collect();
    println!("parts done by each worker for another: {done:?}");
    assert!(done.iter().sum::<usize>() > 0, "nobody helped");

    let before: Vec<usize> = workers.iter().map(|worker| worker.said("a part begins")).collect();
    let accepted = server.post("/v1/jobs", &job).json();
    let id = accepted["id"].as_str().unwrap();
    let busy = loop {
        let now = server.get(&format!("/v1/jobs/{id}")).json();
        assert!(["accepted", "running"].contains(&now["status"].as_str().unwrap()), "nobody helped: {now}");
        if let Some(k) = workers.iter().zip(&before).position(|(own, before)| own.said("a part begins") > *before) {
            break k;
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    drop(workers.remove(busy));
    let ended = server.wait(id);
    assert_eq!((&ended["status"], &ended["attempt"]), (&json!("successful"), &json!(1)), "{ended}");
    let map = format!("/v1/maps/{}/coefficients", ended["map_id"].as_str().unwrap());
    assert!(server.send("GET", &map, &[("accept", "application/x-npz")], None).body == expected[0]);
    let until = std::time::Instant::now() + Duration::from_secs(10);
    while letters(data.path()) > 0 {
        assert!(std::time::Instant::now() < until, "{} files of parts are left", letters(data.path()));
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn workers_of_other_processes_take_parts_and_may_die_sqlite() {
    helped(&[]);
}

#[test]
fn workers_of_other_processes_take_parts_and_may_die_postgres() {
    let url = postgres_server::database();
    helped(&["--database-url", &url]);
}

/// A building's job of so many rooms a side, in parts.
fn building(side: usize) -> Value {
    let noise = Noise { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };
    let halls = mapfit::sim::Survey::halls(side, noise.sigma_range, 1);
    let scans = mapfit::sim::misplaced(&halls.scans, &noise, 2);
    mapfit::import::to_request(&scans, &noise, None, ("vdf", 0.2))
}

/// What a second worker process gains: `SIDE=16 cargo test --release --test parts -- --ignored --nocapture`.
#[test]
#[ignore = "minutes, and needs both cores; run by hand"]
fn a_second_worker_process_takes_its_share() {
    let side = std::env::var("SIDE").map_or(8, |side| side.parse().unwrap());
    let job = building(side);
    let mut maps = Vec::new();
    for count in [1, 2, 1, 2] {
        let data = tempfile::tempdir().unwrap();
        let server = Server::start_with(data.path(), 0, &["--max-control-points", "600"]);
        let start = |k: usize| Worker::start(data.path(), data.path().join(format!("worker-{k}.log")), &[]);
        let workers: Vec<Worker> = (0..count).map(start).collect();
        let (ended, bytes) = fitted(&server, &job);
        let map = server.get(&format!("/v1/maps/{}", ended["map_id"].as_str().unwrap())).json();
        let done: usize = workers.iter().map(|worker| worker.said("a part is done")).sum();
        let left: usize = workers.iter().map(|worker| worker.said("left to others")).sum();
        println!(
            "{count} workers: {} s, {}; {done} parts done for another, {left} left",
            map["fit"]["seconds"], map["fit"]["stages"]
        );
        maps.push(bytes);
    }
    assert!(maps.iter().all(|bytes| *bytes == maps[0]));
}
