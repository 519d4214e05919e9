//! A client of the service, for `submit` and `demo`: what any other client does, over HTTP.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;

use super::CliError;

/// Waiting for a job ends a poll after this many seconds and asks again.
const WAIT: &str = "2";
/// Answers larger than this are not read.
const LARGEST_ANSWER: u64 = 1 << 30;

pub struct Client {
    agent: ureq::Agent,
    base: String,
}

impl Client {
    /// `base` is the service's address; `http://` may be left out.
    pub fn new(base: &str) -> Self {
        let base = &if base.contains("://") { base.to_owned() } else { format!("http://{base}") };
        let mut config = ureq::Agent::config_builder();
        if ["://127.", "://localhost", "://[::1]"].iter().any(|local| base.contains(local)) {
            // A proxy of the environment is for the world outside.
            config = config.proxy(None);
        }
        let config = config
            .http_status_as_error(false)
            .timeout_connect(Some(Duration::from_secs(10)))
            .timeout_global(Some(Duration::from_secs(600)))
            .build();
        Self { agent: config.into(), base: base.trim_end_matches('/').to_owned() }
    }

    /// Submits a request and gives the job.
    pub fn submit(&self, json: &[u8]) -> Result<Value, CliError> {
        let packed = zstd::encode_all(json, 3).map_err(CliError::io("the request cannot be compressed"))?;
        let answer = self
            .agent
            .post(format!("{}/v1/jobs", self.base))
            .content_type("application/json")
            .header("content-encoding", "zstd")
            .send(&packed);
        self.json(answer)
    }

    /// Waits for a job to end, with a progress bar on a terminal.
    pub fn wait(&self, job: &Value) -> Result<Value, CliError> {
        let id = text(job, "id");
        let bar = ProgressBar::new(100);
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {pos:>3} %  {msg}  [{elapsed}]") {
            bar.set_style(style);
        }
        loop {
            let job = self.json(self.agent.get(format!("{}/v1/jobs/{id}?wait=0", self.base)).call())?;
            let progress = &job["progress"];
            bar.set_position(progress["percent"].as_f64().unwrap_or(0.0) as u64);
            let stage = text(progress, "stage");
            bar.set_message(match progress["objective"].as_f64() {
                Some(objective) => format!("{stage}, step {}, objective {objective:.4}", progress["iteration"]),
                None => stage,
            });
            match text(&job, "status").as_str() {
                "successful" => {
                    bar.finish();
                    return Ok(job);
                }
                "failed" | "dismissed" => {
                    bar.abandon();
                    let why = job["problem"]["detail"].as_str().unwrap_or("it was cancelled");
                    return Err(CliError::Server(format!("job {id} is {}: {why}", text(&job, "status"))));
                }
                _ if bar.is_hidden() => {
                    self.json(self.agent.get(format!("{}/v1/jobs/{id}?wait={WAIT}", self.base)).call())?;
                }
                _ => std::thread::sleep(Duration::from_millis(120)),
            }
        }
    }

    pub fn get_json(&self, path: &str) -> Result<Value, CliError> {
        self.json(self.agent.get(self.url(path)).call())
    }

    pub fn get_bytes(&self, path: &str) -> Result<Vec<u8>, CliError> {
        let mut response = self.agent.get(self.url(path)).call().map_err(|error| self.unreachable(&error))?;
        if !response.status().is_success() {
            return Err(CliError::Server(format!("{path}: {}", response.status())));
        }
        let body = response.body_mut().with_config().limit(LARGEST_ANSWER).read_to_vec();
        body.map_err(|error| self.unreachable(&error))
    }

    pub fn url(&self, path: &str) -> String {
        format!("{}{path}", self.base)
    }

    fn json(&self, answer: Result<ureq::http::Response<ureq::Body>, ureq::Error>) -> Result<Value, CliError> {
        let mut response = answer.map_err(|error| self.unreachable(&error))?;
        let status = response.status();
        let body = response.body_mut().with_config().limit(LARGEST_ANSWER).read_to_string();
        let body = body.map_err(|error| self.unreachable(&error))?;
        let value: Value = serde_json::from_str(&body)
            .map_err(|_| CliError::Server(format!("{} does not speak mapfit's contract ({status})", self.base)))?;
        if status.is_success() { Ok(value) } else { Err(CliError::Server(complaint(&value))) }
    }

    fn unreachable(&self, error: &ureq::Error) -> CliError {
        CliError::Unreachable(format!("{} cannot be reached: {error}. Is `mapfit serve` running there?", self.base))
    }
}

/// A problem, with its faults, in words.
fn complaint(problem: &Value) -> String {
    let mut words = format!("{}: {}", text(problem, "title"), text(problem, "detail"));
    for fault in problem["errors"].as_array().into_iter().flatten().take(20) {
        let place = fault["pointer"].as_str().or(fault["parameter"].as_str()).unwrap_or("");
        words.push_str(&format!("\n  {place} {}", text(fault, "detail")));
    }
    words
}

pub(super) fn text(value: &Value, member: &str) -> String {
    value[member].as_str().unwrap_or_default().to_owned()
}
