//! Traces: one a job, from its request to its artifact, across processes; and nothing of it where nobody takes them.
//!
//! The receiver is Python's, with OpenTelemetry's own protobuf classes: `tests/judges/traces.py`.

#[path = "support/postgres.rs"]
mod postgres_server;
mod support;

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use support::{Server, small};

/// What a client's own trace is.
const TRACE: &str = "4bf92f3577b34da6a3ce929d0e0e4736";
const CLIENTS: &str = "00f067aa0ba902b7";

/// A process that is killed when it is dropped.
struct Process(Child);

impl Process {
    fn end(mut self) -> Duration {
        let began = Instant::now();
        assert!(Command::new("kill").arg(self.0.id().to_string()).status().unwrap().success());
        self.0.wait().unwrap();
        began.elapsed()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Who takes spans, and those it has taken.
struct Taker {
    process: Process,
    address: String,
    spans: Receiver<Value>,
}

impl Taker {
    fn start(arguments: &[&str]) -> Self {
        let python = std::env::var_os("MAPFIT_PYTHON").expect("MAPFIT_PYTHON names the judges' Python: scripts/python");
        let mut command = Command::new(python);
        command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/judges/traces.py")).args(arguments);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let address = format!("http://127.0.0.1:{}", lines.next().unwrap().unwrap());
        let (sender, spans) = channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let _ = sender.send(serde_json::from_str(&line).unwrap());
            }
        });
        Self { process: Process(child), address, spans }
    }

    /// What has come, once nothing more does.
    fn all(&self) -> Vec<Value> {
        std::iter::from_fn(|| self.spans.recv_timeout(Duration::from_secs(4)).ok()).collect()
    }
}

fn worker(data: &Path, arguments: &[&str]) -> Process {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
    command.args(["worker", "--workers", "1", "--log", "error", "--data"]).arg(data).args(arguments);
    Process(command.spawn().unwrap())
}

/// Submits under a client's own span.
fn submit(server: &Server, job: &Value, traceparent: &str) -> String {
    let headers = [("content-type", "application/json"), ("traceparent", traceparent), ("x-request-id", "the-request")];
    let answer = server.send("POST", "/v1/jobs", &headers, Some(job.to_string().as_bytes()));
    assert_eq!(answer.status, 202, "{}", answer.json());
    answer.json()["id"].as_str().unwrap().to_owned()
}

fn clients_span() -> String {
    format!("00-{TRACE}-{CLIENTS}-01")
}

fn named<'a>(spans: &'a [Value], name: &str) -> &'a Value {
    let mut all = spans.iter().filter(|span| span["name"] == name);
    let one = all.next().unwrap_or_else(|| panic!("no span {name} in {spans:#?}"));
    assert!(all.next().is_none(), "two spans {name}");
    one
}

/// A job's trace, from a server and a worker that share `stores`.
fn one_trace_a_job(stores: &[&str]) {
    let (folder, taker) = (tempfile::tempdir().unwrap(), Taker::start(&[]));
    let arguments = [stores, &["--otlp-endpoint", &taker.address]].concat();
    let server = Server::start_with(folder.path(), 0, &arguments);
    let id = submit(&server, &small(1), &clients_span());
    let works = worker(folder.path(), &arguments);
    let job = server.wait(&id);
    assert_eq!(job["status"], "successful");
    // A reader that brings no trace makes no spans; what did not go out yet does when the processes end.
    works.end();
    server.signal("-TERM");
    let spans = taker.all();
    assert!(spans.iter().all(|span| span["trace"] == TRACE), "{spans:#?}");
    assert_eq!(spans.len(), 10, "{spans:#?}");

    let (request, submission, attempt) =
        (named(&spans, "POST /v1/jobs"), named(&spans, "submit"), named(&spans, "attempt"));
    assert_eq!((&request["parent"], &request["kind"]), (&json!(CLIENTS), &json!("server")));
    assert_eq!((&submission["parent"], &submission["kind"]), (&request["id"], &json!("producer")));
    assert_eq!((&attempt["parent"], &attempt["kind"]), (&submission["id"], &json!("consumer")));
    assert_eq!(request["attributes"]["http.response.status_code"], 202);
    assert_eq!(request["attributes"]["mapfit.request.id"], "the-request");
    for span in [submission, attempt] {
        assert_eq!(span["attributes"]["mapfit.job.id"], *id);
    }
    assert_eq!(attempt["attributes"]["mapfit.outcome"], "successful");
    // The stages follow one another within the attempt.
    let stages = ["claim", "load", "wait for memory", "fit", "covariance", "store", "finish"];
    let mut before = attempt["start"].as_u64().unwrap();
    for stage in stages.map(|name| named(&spans, name)) {
        assert_eq!(stage["parent"], attempt["id"], "{stage}");
        let (start, end) = (stage["start"].as_u64().unwrap(), stage["end"].as_u64().unwrap());
        assert!(before <= start && start <= end, "{stages:?}: {spans:#?}");
        before = end;
    }
    assert!(before <= attempt["end"].as_u64().unwrap());
    // Two processes made them.
    let role = |span: &Value| span["process"]["mapfit.role"].as_str().unwrap().to_owned();
    assert_eq!((role(request), role(submission)), ("serve".into(), "serve".into()));
    assert!(spans.iter().filter(|span| role(span) == "worker").count() == 8);
    assert_ne!(request["process"]["service.instance.id"], attempt["process"]["service.instance.id"]);
    assert_eq!(request["process"]["service.name"], "mapfit");
}

#[test]
fn a_job_has_one_trace_across_processes_on_sqlite() {
    one_trace_a_job(&[]);
}

#[test]
fn a_job_has_one_trace_across_processes_on_postgres() {
    let database = postgres_server::database();
    one_trace_a_job(&["--database-url", &database]);
}

#[test]
fn a_server_that_keeps_none_passes_a_clients_trace_on() {
    let (folder, taker) = (tempfile::tempdir().unwrap(), Taker::start(&[]));
    let server = Server::start(folder.path(), 0);
    // Ranges known to a micrometre on a lattice of half a metre: no f64 holds both.
    let mut exact = small(1);
    exact["noise"] = json!({"sigma_x": 1e-6, "sigma_y": 1e-6, "sigma_theta": 1e-6, "sigma_range": 1e-6});
    exact["fit"] = json!({"model_sigma": 0});
    exact["map"]["distance"] = json!("vdf");
    let unsampled = clients_span().replace("-01", "-00");
    let untraced = ["", "00-zz", &unsampled].map(|traceparent| submit(&server, &small(2), traceparent));
    let fails = submit(&server, &exact, &clients_span());
    // The usual variable, without a flag.
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
    command.args(["worker", "--workers", "1", "--log", "error", "--data"]).arg(folder.path());
    let works = Process(command.env("OTEL_EXPORTER_OTLP_ENDPOINT", &taker.address).spawn().unwrap());
    let job = server.wait(&fails);
    assert_eq!(job["status"], "failed");
    for id in untraced {
        assert_eq!(server.wait(&id)["status"], "successful");
    }
    works.end();
    let spans = taker.all();
    let (traced, others): (Vec<_>, Vec<_>) = spans.into_iter().partition(|span| span["trace"] == TRACE);
    let attempt = named(&traced, "attempt");
    assert_eq!((&attempt["parent"], &attempt["status"]), (&json!(CLIENTS), &json!("error")));
    assert_eq!(attempt["message"], job["problem"]["detail"]);
    let came_to_nothing: Vec<&Value> = traced.iter().filter(|span| span["status"] == "error").collect();
    assert_eq!(came_to_nothing.len(), 2, "the attempt, and its stage: {came_to_nothing:#?}");
    assert!(came_to_nothing.iter().any(|span| span["name"] == "fit" || span["name"] == "covariance"));
    assert_eq!(attempt["attributes"]["mapfit.outcome"], "failed");
    // Whoever brings none, or something else, has a trace of the worker's; whoever asks not to be traced is not.
    let attempts: Vec<&Value> = others.iter().filter(|span| span["name"] == "attempt").collect();
    assert_eq!(attempts.len(), 2);
    assert!(attempts.iter().all(|span| span["parent"] == "" && span["status"] == "unset"));
}

/// Resident memory, bytes.
fn resident(process: &Process) -> u64 {
    let pages = std::fs::read_to_string(format!("/proc/{}/statm", process.0.id())).unwrap();
    pages.split(' ').nth(1).unwrap().parse::<u64>().unwrap() * 4096
}

/// However the receiver is away: nobody listens, or somebody who does not answer.
#[test]
fn a_receiver_that_is_away_hurts_no_job() {
    let silent = Taker::start(&["--silent"]);
    for address in ["http://127.0.0.1:9", &silent.address] {
        let folder = tempfile::tempdir().unwrap();
        let server = Server::start_with(folder.path(), 0, &["--otlp-endpoint", address]);
        let works = worker(folder.path(), &["--otlp-endpoint", address]);
        let run = |seeds: std::ops::Range<u64>| {
            let ids: Vec<String> = seeds.map(|seed| server.submit(&small(seed % 4))).collect();
            for id in &ids {
                assert_eq!(server.wait(id)["status"], "successful");
            }
        };
        run(0..20);
        let before = resident(&works);
        // 1,600 spans of the worker's, four times as many as one batch has.
        run(0..200);
        let grown = resident(&works).saturating_sub(before);
        println!("{address}: the worker grew by {} KiB", grown >> 10);
        assert!(grown < 32 << 20);
        let took = works.end();
        assert!(took < Duration::from_secs(5), "it ends when it is told to, {took:?}");
        server.signal("-TERM");
    }
    drop(silent.process);
}

#[test]
fn an_address_that_is_none_is_said_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
    let command = command.args(["worker", "--otlp-endpoint", "collector:4318", "--data"]).arg(folder.path());
    let said = command.output().unwrap();
    assert_eq!(said.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&said.stderr).contains("collector:4318"));
}
