//! A whole service whose maps lie in a bucket of a real S3 server: the same maps as in a folder, also where that server is
//! killed while jobs flow.

#[path = "support/postgres.rs"]
mod postgres_server;
#[path = "support/seaweed.rs"]
mod seaweed;
mod support;

use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use object_store::ObjectStoreExt;
use seaweed::Seaweed;
use serde_json::Value;
use support::{Server, small};

fn database() -> String {
    postgres_server::database()
}

/// A process that works and does not serve; killed when it is dropped.
struct Worker(Child);

impl Worker {
    fn start(data: &Path, arguments: &[&str], store: &Seaweed) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command.args(["worker", "--workers", "1", "--log", "error"]).args(arguments).arg("--data").arg(data);
        Self(command.envs(store.variables()).spawn().unwrap())
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// What is the same whenever the same is fitted: a map's file also has its seconds.
fn arrays(server: &Server, map: &str) -> Vec<Vec<u8>> {
    ["coefficients?format=npz", "covariance?form=sparse", "covariance?format=npz"]
        .map(|what| {
            let answer = server.get(&format!("/v1/maps/{map}/{what}"));
            assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
            answer.body
        })
        .to_vec()
}

/// The maps of jobs of these seeds, by a service in a folder.
fn undisturbed(seeds: u64) -> Vec<Vec<Vec<u8>>> {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    (0..seeds).map(|seed| arrays(&server, &server.map_of(&small(seed)))).collect()
}

fn map_of(server: &Server, job: &str) -> String {
    let job = server.wait(job);
    assert_eq!(job["status"], "successful", "{job}");
    job["map_id"].as_str().unwrap().to_owned()
}

#[test]
fn sqlite_with_a_bucket_has_the_folders_maps() {
    let (data, store) = (tempfile::tempdir().unwrap(), Seaweed::start());
    let server = Server::start_among(data.path(), 2, &["--artifacts", "s3://maps/fleet"], &store.variables());
    let expected = undisturbed(3);
    let maps: Vec<String> = (0..3).map(|seed| server.map_of(&small(seed))).collect();
    for (map, expected) in maps.iter().zip(&expected) {
        assert!(arrays(&server, map) == *expected, "the same bytes");
    }
    assert!(!data.path().join("artifacts").exists());
    let names = store.names("maps");
    assert_eq!(names.len(), 3, "{names:?}");
    assert!(names.iter().all(|name| name.starts_with("fleet/attempts/")), "{names:?}");
    assert_eq!(server.delete(&format!("/v1/maps/{}", maps[0])).status, 204);
    assert_eq!(store.names("maps").len(), 2);
}

#[test]
fn a_damaged_object_is_not_served() {
    let (data, store) = (tempfile::tempdir().unwrap(), Seaweed::start());
    let start = || Server::start_among(data.path(), 1, &["--artifacts", "s3://maps/fleet"], &store.variables());
    let map = start().map_of(&small(1));
    let (bucket, name) = (store.bucket("maps"), store.names("maps").remove(0));
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let mut bytes = bucket.get(&name.clone().into()).await.unwrap().bytes().await.unwrap().to_vec();
        // One bit of the array itself, so that the archive is still one.
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        bucket.put(&name.clone().into(), bytes.into()).await.unwrap();
    });
    let server = start();
    for what in ["coefficients", "image", "query"] {
        let answer = match what {
            "query" => server.post(&format!("/v1/maps/{map}/query"), &serde_json::json!({"points": [[1, 1]]})),
            what => server.get(&format!("/v1/maps/{map}/{what}")),
        };
        assert_eq!(answer.problem(500)["type"], "/problems/artifact-damaged");
    }
    runtime.block_on(bucket.delete(&name.into())).unwrap();
    let missing = server.get(&format!("/v1/maps/{map}/coefficients")).problem(500);
    assert_eq!(missing["type"], "/problems/artifact-missing");
}

/// A store that takes 20 kB a second: a map is longer under way to it than a lease holds. The lease is kept meanwhile, and
/// whoever asks for something else does not notice.
#[test]
fn a_slow_store_costs_time_and_nothing_else() {
    let (data, store) = (tempfile::tempdir().unwrap(), Seaweed::start());
    let arguments = ["--artifacts", "s3://maps", "--lease-seconds", "1"];
    let server = Server::start_among(data.path(), 2, &arguments, &store.slowly(20_000));
    let expected = undisturbed(2);
    let (begun, jobs) = (Instant::now(), [server.submit(&small(0)), server.submit(&small(1))]);
    let mut slowest = Duration::ZERO;
    let mut storing = 0;
    while !jobs.iter().all(|id| server.get(&format!("/v1/jobs/{id}")).json()["status"] == "successful") {
        let asked = Instant::now();
        let job = server.get(&format!("/v1/jobs/{}", jobs[0])).json();
        slowest = slowest.max(asked.elapsed());
        storing += usize::from(job["progress"]["stage"] == "storing");
        assert!(begun.elapsed() < Duration::from_secs(120), "{job}");
        std::thread::sleep(Duration::from_millis(50));
    }
    println!("stored after {:?}; slowest answer meanwhile {slowest:?}", begun.elapsed());
    assert!(storing > 40, "it was not slow: {storing}");
    assert!(slowest < Duration::from_secs(1));
    for (job, expected) in jobs.iter().zip(&expected) {
        let job = server.wait(job);
        assert_eq!(job["attempt"], 1, "{job}");
        assert!(arrays(&server, job["map_id"].as_str().unwrap()) == *expected, "the same bytes");
    }
}

/// Submits until it is accepted, under one key: a server whose database is away says so, and may have accepted it.
fn submit(server: &Server, request: &Value, key: &str) -> String {
    let (body, begun) = (request.to_string(), Instant::now());
    let headers = [("content-type", "application/json"), ("idempotency-key", key)];
    loop {
        let answer = server.send("POST", "/v1/jobs", &headers, Some(body.as_bytes()));
        match answer.status {
            200 | 202 => return answer.json()["id"].as_str().unwrap().to_owned(),
            503 => assert!(begun.elapsed() < Duration::from_secs(60)),
            _ => panic!("{}", String::from_utf8_lossy(&answer.body)),
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// PostgreSQL and S3, two servers, two workers; the S3 server is killed and started again while jobs flow, twice, and the
/// database is shut down at once and started anew.
#[test]
fn killed_stores_lose_nothing() {
    const JOBS: u64 = 60;
    const SEEDS: u64 = 6;
    let (data, store, url) = (tempfile::tempdir().unwrap(), Seaweed::start(), database());
    let arguments =
        ["--database-url", &url, "--artifacts", "s3://maps", "--lease-seconds", "2", "--sweep-seconds", "1"];
    let servers = [0; 2].map(|_| Server::start_among(data.path(), 0, &arguments, &store.variables()));
    let _workers = [0; 2].map(|_| Worker::start(data.path(), &arguments[..6], &store));
    let expected = undisturbed(SEEDS);
    let first = servers[0].map_of(&small(0));
    let mut ids = Vec::new();
    for k in 0..JOBS {
        let server = &servers[k as usize % 2];
        ids.push(submit(server, &small(k % SEEDS), &format!("key {k}")));
        match k {
            15 => {
                store.kill();
                let begun = Instant::now();
                let unready = server.get("/readyz");
                assert_eq!(unready.status, 503, "{}", String::from_utf8_lossy(&unready.body));
                server.get(&format!("/v1/maps/{first}/coefficients")).problem(503);
                println!("said after {:?}", begun.elapsed());
                assert!(begun.elapsed() < Duration::from_secs(10));
            }
            // Jobs are accepted meanwhile, and fitted; so much time that attempts would have been used up.
            30 => {
                std::thread::sleep(Duration::from_secs(8));
                store.start_again();
            }
            38 | 52 => postgres_server::restart(),
            45 => {
                std::thread::sleep(Duration::from_secs(2));
                store.kill();
                std::thread::sleep(Duration::from_secs(1));
                store.start_again();
            }
            _ => {}
        }
    }
    let begun = Instant::now();
    let maps: Vec<String> = ids.iter().map(|id| map_of(&servers[0], id)).collect();
    println!("the rest took {:?}", begun.elapsed());
    for (k, map) in maps.iter().enumerate() {
        assert!(arrays(&servers[k % 2], map) == expected[k % SEEDS as usize], "map {k} differs");
    }
    let ready = servers[1].get("/readyz");
    assert_eq!(ready.status, 200, "{}", String::from_utf8_lossy(&ready.body));
    let used = servers[1].get("/v1/usage").json()["maps"]["used"].as_u64();
    assert_eq!(used, Some(JOBS + 1), "no map is missing or doubled");
    let fresh = Server::start_among(data.path(), 0, &arguments, &store.variables());
    for (k, map) in maps.iter().enumerate() {
        assert!(arrays(&fresh, map) == expected[k % SEEDS as usize], "map {k} differs when nothing is remembered");
    }
    ids.push(fresh.get(&format!("/v1/maps/{first}")).json()["job_id"].as_str().unwrap().to_owned());
    assert!(arrays(&fresh, &first) == expected[0], "the first map differs");
    only_named_objects_are_left(&store, &ids);
}

/// What was left by tries that failed is swept within seconds: no object is another's than a job's, and none has two. That
/// every job's object is there was judged by reading it: a listing of a killed `weed` was once seen to lack what it served.
fn only_named_objects_are_left(store: &Seaweed, jobs: &[String]) {
    let begun = Instant::now();
    loop {
        let names: Vec<String> = store.names("maps").into_iter().filter(|name| name.starts_with("attempts/")).collect();
        let of = |job: &String| names.iter().filter(|name| name.split('/').any(|part| part.contains(job))).count();
        let (orphans, doubled) = (names.len() - jobs.iter().map(of).sum::<usize>(), jobs.iter().any(|job| of(job) > 1));
        if orphans == 0 && !doubled {
            return;
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "{orphans} orphans, doubled: {doubled}, of {names:?}");
        std::thread::sleep(Duration::from_millis(500));
    }
}
