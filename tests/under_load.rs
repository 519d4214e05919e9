//! Two hundred jobs at once while queries run; and the same bytes whatever the number of workers.

mod support;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::json;
use support::{Server, experiment_one, small};

#[test]
fn two_hundred_jobs_by_eight_clients_each_end_once_and_answers_stay_prompt() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 2);
    let map = server.map_of(&small(0));
    let done = AtomicBool::new(false);
    let (ids, mut latencies) = std::thread::scope(|scope| {
        let clients: Vec<_> = (0..8)
            .map(|client| {
                let server = &server;
                scope.spawn(move || (0..25).map(|k| server.submit(&small(client * 25 + k))).collect::<Vec<_>>())
            })
            .collect();
        let (server, done, map) = (&server, &done, &map);
        let queries = scope.spawn(move || {
            let points: Vec<[f64; 2]> = (0..500).map(|k| [0.01 * f64::from(k), 2.0]).collect();
            while !done.load(Ordering::Relaxed) {
                let answer = server.post(&format!("/v1/maps/{map}/query"), &json!({"points": points}));
                assert_eq!(answer.status, 200);
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        let ids: Vec<String> = clients.into_iter().flat_map(|client| client.join().unwrap()).collect();
        let mut latencies = vec![];
        let begun = Instant::now();
        for id in ids.iter().cycle() {
            let asked = Instant::now();
            let answer = server.get(&format!("/v1/jobs/{id}"));
            latencies.push(asked.elapsed());
            assert_eq!(answer.status, 200);
            if latencies.len() % 200 == 0 {
                let waiting = server.get("/v1/jobs?status=accepted&limit=1").json()["items"].as_array().unwrap().len();
                let running = server.get("/v1/jobs?status=running&limit=1").json()["items"].as_array().unwrap().len();
                if waiting + running == 0 {
                    break;
                }
            }
            assert!(begun.elapsed() < Duration::from_secs(180), "the jobs do not end");
            std::thread::sleep(Duration::from_millis(2));
        }
        done.store(true, Ordering::Relaxed);
        queries.join().unwrap();
        (ids, latencies)
    });
    for id in &ids {
        let job = server.get(&format!("/v1/jobs/{id}")).json();
        assert_eq!((&job["status"], &job["attempt"]), (&json!("successful"), &json!(1)), "{job}");
    }
    let mut maps = std::collections::BTreeSet::new();
    let mut cursor = String::new();
    loop {
        let page = server.get(&format!("/v1/maps?limit=100{cursor}")).json();
        maps.extend(page["items"].as_array().unwrap().iter().map(|map| map["job_id"].to_string()));
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(maps.len(), 201, "one map a job");
    latencies.sort();
    let p99 = latencies[latencies.len() * 99 / 100];
    println!("p99 of GET /v1/jobs/{{id}} under load: {p99:?} of {} requests", latencies.len());
    assert!(p99 < Duration::from_millis(50), "{p99:?}");
}

#[test]
fn one_worker_and_four_give_the_same_bytes() {
    let coefficients = |workers: usize| {
        let folder = tempfile::tempdir().unwrap();
        let server = Server::start(folder.path(), workers);
        let jobs: Vec<String> = (0..6).map(|k| server.submit(&experiment_one(k % 3))).collect();
        let arrays = |id: &String| {
            let map = server.wait(id)["map_id"].as_str().unwrap().to_owned();
            let coefficients = server.get(&format!("/v1/maps/{map}/coefficients?format=npz")).body;
            let covariance = server.get(&format!("/v1/maps/{map}/covariance?form=sparse")).body;
            (coefficients, covariance)
        };
        jobs.iter().map(arrays).collect::<Vec<_>>()
    };
    let (one, four) = (coefficients(1), coefficients(4));
    assert!(one == four, "the number of workers changes the bytes");
    assert!(one[0] == one[3] && one[0] != one[1], "the same job is the same map, another job another");
}
