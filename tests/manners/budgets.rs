//! Work and memory: who left is not worked for, and nothing takes more than there is.

use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::connect;
use crate::support::{Server, experiment_one, long, small};

/// Twenty thousand scans of one beam, each of which may have crossed the whole lattice: no work that cannot be stopped.
#[test]
fn many_thin_scans_of_a_large_lattice_stop_when_they_are_told() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let pose = json!({"x": -1.0, "y": -1.0, "theta": std::f64::consts::FRAC_PI_4});
    let scan = json!({"pose": pose, "angle_min": 0.0, "angle_increment": 1e-6, "range_min": 0.1, "range_max": 30.0,
        "ranges": [13.9]});
    let mut job = small(1);
    job["scans"] = vec![scan; 20_000].into();
    job["map"] = json!({"distance": "vdf", "resolution": 0.02, "bounds": {"min": [0, 0], "max": [8.88, 8.88]}});
    let id = server.submit(&job);
    while server.get(&format!("/v1/jobs/{id}")).json()["status"] == "accepted" {
        std::thread::sleep(Duration::from_millis(50));
    }
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(server.delete(&format!("/v1/jobs/{id}")).status, 200);
    let began = Instant::now();
    server.map_of(&small(2));
    println!("the worker was free {:.1?} after the cancellation", began.elapsed());
    assert!(began.elapsed() < Duration::from_secs(8));
}

/// Seconds of a core that a server has used.
fn processor_seconds(server: &Server) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", server.child.id())).unwrap();
    // After the name, which may have blanks; user and system time are the 14th and 15th field, in hundredths.
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_ascii_whitespace().collect();
    fields[11..13].iter().map(|ticks| ticks.parse::<f64>().unwrap() / 100.0).sum()
}

/// What it has used once it rests.
fn rested(server: &Server) -> f64 {
    let (begun, mut before) = (Instant::now(), processor_seconds(server));
    loop {
        std::thread::sleep(Duration::from_millis(500));
        let now = processor_seconds(server);
        if now - before < 0.05 {
            return now;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "it goes on and on");
        before = now;
    }
}

/// Forty clients that ask for large pictures and grids, each for another, and leave: those that were begun are left in the
/// middle, one a core, and no others are begun.
#[test]
fn what_nobody_waits_for_any_more_is_not_made() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    for asked in ["image?width=", "ogm?format=zip&resolution=0.01"] {
        let path = |k: usize| format!("{own}/{asked}{}", 4096 - k);
        let before = rested(&server);
        assert_eq!(server.get(&path(0)).status, 200);
        let after_one = rested(&server);
        let one = after_one - before;
        let ask = |k: usize| {
            let mut client = connect(&server);
            client.write_all(format!("GET {} HTTP/1.1\r\nHost: localhost\r\n\r\n", path(k)).as_bytes()).unwrap();
            client
        };
        let clients: Vec<TcpStream> = (1..=40).map(ask).collect();
        std::thread::sleep(Duration::from_millis(100));
        drop(clients);
        let spent = rested(&server) - after_one;
        println!("{asked}: one takes {one:.2} s, forty that nobody waits for {spent:.2} s");
        assert!(spent < 0.5 * one + 0.5, "{asked}: {spent:.2} s; one takes {one:.2} s");
    }
}

/// Answers that form a fit's factors anew, again and again, and submissions beside them.
#[test]
fn submissions_do_not_wait_for_heavy_answers() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let mut large = experiment_one(1);
    large["map"]["resolution"] = json!(0.1);
    let own = format!("/v1/maps/{}/covariance", server.map_of(&large));
    let done = AtomicBool::new(false);
    let ask = |path: &str| {
        let mut answers = 0;
        while !done.load(Ordering::Relaxed) {
            assert_eq!(server.get(&format!("{own}?{path}")).status, 200);
            answers += 1;
        }
        answers
    };
    std::thread::scope(|scope| {
        let factors = scope.spawn(|| ask("form=factors"));
        let block = scope.spawn(|| ask("form=block&i0=20&j0=20&ni=32&nj=32&format=npz"));
        let mut slowest = Duration::ZERO;
        for seed in 0..10 {
            std::thread::sleep(Duration::from_millis(200));
            let began = Instant::now();
            assert_eq!(server.post("/v1/jobs", &small(seed)).status, 202);
            slowest = slowest.max(began.elapsed());
        }
        done.store(true, Ordering::Relaxed);
        let answers = [factors.join().unwrap(), block.join().unwrap()];
        println!("the slowest of ten submissions took {slowest:.1?} beside {answers:?} answers");
        assert!(slowest < Duration::from_secs(1), "{slowest:?}");
    });
}

/// How many jobs stand at one of these stages.
fn at(jobs: &[Value; 2], stages: &[&str]) -> usize {
    jobs.iter().filter(|job| stages.iter().any(|stage| job["progress"]["stage"] == *stage)).count()
}

/// The memory that is there is enough for one of two fits: the other waits, and both come to their end.
#[test]
fn fits_that_do_not_fit_beside_each_other_follow_one_another() {
    let mut job = experiment_one(1);
    job["map"]["resolution"] = json!(0.08);
    let folder = tempfile::tempdir().unwrap();
    let usual = Server::start(&folder.path().join("usual"), 0);
    let need = usual.post("/v1/jobs?dry_run=true", &job).json()["estimate"]["bytes"].as_u64().unwrap();
    let memory = ((need >> 20) + 1).to_string();
    let server = Server::start_with(&folder.path().join("little"), 2, &["--memory", &memory]);
    let both = [server.submit(&job), server.submit(&job)];
    let (mut has_waited, mut together, begun) = (false, None::<Instant>, Instant::now());
    loop {
        let jobs = both.each_ref().map(|id| server.get(&format!("/v1/jobs/{id}")).json());
        let fitting = at(&jobs, &["fitting", "covariance"]);
        has_waited |= fitting == 1 && at(&jobs, &["waiting for memory"]) == 1;
        // A stage is told half a second late.
        if fitting == 2 {
            assert!(together.get_or_insert_with(Instant::now).elapsed() < Duration::from_secs(1), "{jobs:?}");
        } else {
            together = None;
        }
        if jobs.iter().all(|job| job["status"] == "successful") {
            break;
        }
        assert!(jobs.iter().all(|job| job["status"] != "failed"), "{jobs:?}");
        assert!(begun.elapsed() < Duration::from_secs(120), "{jobs:?}");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(has_waited, "one of them waited for memory");
}

#[test]
fn a_job_that_needs_more_memory_than_there_is_is_refused_at_once() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 0, &["--memory", "16"]);
    let problem = server.post("/v1/jobs", &long(1)).problem(422);
    let fault = &problem["errors"][0];
    assert_eq!(fault["pointer"], "/map/resolution");
    let detail = fault["detail"].as_str().unwrap();
    assert!(detail.contains("16 MiB (--memory)"), "{detail}");
    assert_eq!(server.post("/v1/jobs", &small(1)).status, 202);
}

/// A map from a larger machine: what is formed from its fit would take what is not there.
#[test]
fn an_answer_that_needs_more_memory_than_there_is_is_refused_at_once() {
    let data = tempfile::tempdir().unwrap();
    let id = Server::start(data.path(), 1).map_of(&experiment_one(1));
    let server = Server::start_with(data.path(), 0, &["--memory", "16"]);
    let asked = Instant::now();
    let block = server.get(&format!("/v1/maps/{id}/covariance?form=block&i0=4&j0=4&ni=4&nj=4"));
    let problem = block.problem(503);
    assert!(problem["detail"].as_str().unwrap().contains("(--memory)"), "{problem}");
    assert!(asked.elapsed() < Duration::from_secs(5));
    assert_eq!(server.get(&format!("/v1/maps/{id}/covariance?form=diagonal")).status, 200);
}
