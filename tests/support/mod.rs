//! A real `mapfit` process on a free port, and a client for it.
#![allow(dead_code)]

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use mapfit::import::to_request;
use mapfit::sim::Scenario;
use serde_json::Value;

/// A running server; killed when it is dropped.
pub struct Server {
    pub child: Child,
    pub url: String,
    agent: ureq::Agent,
}

/// An answer: status, headers, body.
pub struct Answer {
    pub status: u16,
    pub headers: ureq::http::HeaderMap,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&self.body)))
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    /// The body, which must be a problem with this status and type.
    pub fn problem(&self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", String::from_utf8_lossy(&self.body));
        assert_eq!(self.header("content-type"), "application/problem+json");
        let problem = self.json();
        for member in ["type", "title", "status", "detail", "instance", "request_id"] {
            assert!(!problem[member].is_null(), "{member} is missing in {problem}");
        }
        assert_eq!(problem["status"], status);
        assert_eq!(problem["request_id"], self.header("x-request-id"));
        problem
    }
}

impl Server {
    pub fn start(data: &Path, workers: usize) -> Self {
        Self::start_with(data, workers, &[])
    }

    /// With further arguments to `serve`.
    pub fn start_with(data: &Path, workers: usize, arguments: &[&str]) -> Self {
        Self::start_among(data, workers, arguments, &[])
    }

    /// With further environment variables.
    pub fn start_among(data: &Path, workers: usize, arguments: &[&str], variables: &[(String, String)]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command
            .args(["serve", "--listen", "127.0.0.1:0", "--log", "warn", "--workers", &workers.to_string()])
            .args(arguments)
            .arg("--data")
            .arg(data)
            .envs(variables.iter().cloned());
        Self::start_command(command)
    }

    /// By a command that becomes the server.
    pub fn start_command(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let url = line.trim().strip_prefix("serving on ").unwrap_or_else(|| panic!("{line}")).to_owned();
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .allow_non_standard_methods(true)
            .timeout_global(Some(Duration::from_secs(120)))
            .proxy(None)
            // As a fleet's server has: as many kept as it has threads. (ureq's own three make most others connect anew.)
            .max_idle_connections_per_host(64)
            .max_idle_connections(64)
            .build();
        Self { child, url, agent: config.into() }
    }

    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], None)
    }

    pub fn delete(&self, path: &str) -> Answer {
        self.send("DELETE", path, &[], None)
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        let body = body.to_string();
        self.send("POST", path, &[("content-type", "application/json")], Some(body.as_bytes()))
    }

    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: Option<&[u8]>) -> Answer {
        let mut request = ureq::http::Request::builder().method(method).uri(format!("{}{path}", self.url));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let mut response = match body {
            Some(body) => self.agent.run(request.body(body).unwrap()).unwrap(),
            None => self.agent.run(request.body(()).unwrap()).unwrap(),
        };
        let body = response.body_mut().with_config().limit(1 << 30).read_to_vec().unwrap();
        Answer { status: response.status().as_u16(), headers: response.headers().clone(), body }
    }

    /// Submits a job and gives its id.
    pub fn submit(&self, request: &Value) -> String {
        let answer = self.post("/v1/jobs", request);
        assert_eq!(answer.status, 202, "{}", answer.json());
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    /// Waits until a job has ended.
    pub fn wait(&self, id: &str) -> Value {
        let begun = Instant::now();
        loop {
            let job = self.get(&format!("/v1/jobs/{id}?wait=20")).json();
            if ["successful", "failed", "dismissed"].contains(&job["status"].as_str().unwrap()) {
                return job;
            }
            assert!(begun.elapsed() < Duration::from_secs(180), "the job does not end: {job}");
        }
    }

    /// Submits, waits, and gives the map's id.
    pub fn map_of(&self, request: &Value) -> String {
        let job = self.wait(&self.submit(request));
        assert_eq!(job["status"], "successful", "{job}");
        job["map_id"].as_str().unwrap().to_owned()
    }

    /// The process's peak resident memory, bytes.
    pub fn peak_memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
        line.split_ascii_whitespace().nth(1).unwrap().parse::<u64>().unwrap() * 1024
    }

    pub fn signal(&self, signal: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Experiment 1's job for a draw of the noise.
pub fn experiment_one(seed: u64) -> Value {
    let scenario = Scenario::experiment_one();
    let mut request =
        to_request(&scenario.scans(seed), &scenario.noise, Some("experiment 1"), ("sdf", scenario.resolution));
    request["map"]["bounds"] = serde_json::json!({"min": scenario.bounds.min, "max": scenario.bounds.max});
    request
}

/// A job that takes some milliseconds: the same room on a coarse lattice.
pub fn small(seed: u64) -> Value {
    let mut request = experiment_one(seed);
    request["map"]["resolution"] = 0.5.into();
    request
}

/// A job that takes tens of seconds.
pub fn long(seed: u64) -> Value {
    let mut request = experiment_one(seed);
    request["map"]["resolution"] = 0.06.into();
    request["fit"] = serde_json::json!({"poses": "fixed"});
    request
}

/// An answer's array of numbers.
pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// The folder `MAPFIT_RECORDINGS` names, or a note that the test was skipped; where `CI` is set a missing folder fails.
pub fn shared_data(test: &str) -> Option<std::path::PathBuf> {
    let folder = std::env::var_os("MAPFIT_RECORDINGS").map(|folder| Path::new(env!("CARGO_MANIFEST_DIR")).join(folder));
    let there = folder.filter(|folder| folder.is_dir());
    assert!(there.is_some() || std::env::var_os("CI").is_none(), "{test}: MAPFIT_RECORDINGS names no folder");
    if there.is_none() {
        eprintln!("SKIPPED {test}: MAPFIT_RECORDINGS names no folder");
    }
    there
}

/// A log's text, unpacked.
pub fn log_text(file: &Path) -> String {
    let mut log = String::new();
    let mut reader = flate2::read::MultiGzDecoder::new(std::fs::File::open(file).unwrap());
    std::io::Read::read_to_string(&mut reader, &mut log).unwrap();
    log
}
