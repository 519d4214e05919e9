//! A client of the service, for the commands that speak to one: what any other client does, over HTTP.

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
    /// An `Authorization` header, where the service wants a key.
    authorization: Option<String>,
}

/// Which service, and by what key.
#[derive(Debug, clap::Args)]
pub struct Remote {
    /// The server.
    #[arg(long, env = "MAPFIT_URL", default_value = "http://127.0.0.1:8080", global = true)]
    url: String,
    /// An API key, where the server wants one.
    #[arg(long, env = "MAPFIT_KEY", hide_env_values = true, global = true)]
    key: Option<String>,
}

impl Remote {
    pub fn client(&self) -> Client {
        Client::new(&self.url, self.key.as_deref())
    }
}

impl Client {
    /// `base` is the service's address; `http://` may be left out.
    pub fn new(base: &str, key: Option<&str>) -> Self {
        let base = &if base.contains("://") { base.to_owned() } else { format!("http://{base}") };
        let mut config = ureq::Agent::config_builder();
        if ["://127.", "://localhost", "://[::1]"].iter().any(|local| base.contains(local)) {
            // A proxy of the environment is for the world outside.
            config = config.proxy(None);
        }
        let config = config
            .http_status_as_error(false)
            .allow_non_standard_methods(true)
            .timeout_connect(Some(Duration::from_secs(10)))
            .timeout_global(Some(Duration::from_secs(600)))
            .build();
        let authorization = key.map(|key| format!("Bearer {key}"));
        Self { agent: config.into(), base: base.trim_end_matches('/').to_owned(), authorization }
    }

    /// Submits a job's request and gives the job.
    pub fn submit(&self, json: &[u8]) -> Result<Value, CliError> {
        self.submit_to("/v1/jobs", json)
    }

    /// Submits a request for a job at an address and gives the job.
    pub fn submit_to(&self, path: &str, json: &[u8]) -> Result<Value, CliError> {
        let packed = zstd::encode_all(json, 3).map_err(CliError::io("the request cannot be compressed"))?;
        let request = self.agent.post(self.url(path)).content_type("application/json");
        self.json(self.keyed(request).header("content-encoding", "zstd").send(&packed))
    }

    /// Sends JSON, or nothing, and reads JSON.
    pub fn send_json(&self, method: &str, path: &str, body: Option<&Value>) -> Result<Value, CliError> {
        let mut request = ureq::http::Request::builder().method(method).uri(self.url(path));
        if let Some(authorization) = &self.authorization {
            request = request.header("authorization", authorization);
        }
        let request = request.header("content-type", "application/json");
        let request = request.body(body.map(Value::to_string).unwrap_or_default());
        let request = request.map_err(|error| CliError::Usage(format!("{path} is no address: {error}")))?;
        self.json(self.agent.run(request))
    }

    /// Deletes what is at an address.
    pub fn delete(&self, path: &str) -> Result<(), CliError> {
        let answer = self.keyed(self.agent.delete(self.url(path))).call().map_err(|error| self.unreachable(&error))?;
        if answer.status().is_success() { Ok(()) } else { self.json(Ok(answer)).map(drop) }
    }

    /// The items of all pages of a list, so many at most.
    pub fn list(&self, path: &str, query: &str, most: usize) -> Result<Vec<Value>, CliError> {
        let (mut items, mut cursor) = (Vec::new(), String::new());
        loop {
            let page =
                self.get_json(&format!("{path}?limit={}&{query}{cursor}", (most - items.len()).clamp(1, 1000)))?;
            items.extend(page["items"].as_array().into_iter().flatten().cloned());
            match page["next_cursor"].as_str() {
                Some(next) if items.len() < most => cursor = format!("&cursor={next}"),
                _ => {
                    items.truncate(most);
                    return Ok(items);
                }
            }
        }
    }

    fn keyed<B>(&self, request: ureq::RequestBuilder<B>) -> ureq::RequestBuilder<B> {
        match &self.authorization {
            Some(authorization) => request.header("authorization", authorization),
            None => request,
        }
    }

    /// Waits for a job to end, with a progress bar on a terminal.
    pub fn wait(&self, job: &Value) -> Result<Value, CliError> {
        let id = text(job, "id");
        let bar = ProgressBar::new(100);
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {pos:>3} %  {msg}  [{elapsed}]") {
            bar.set_style(style);
        }
        loop {
            let job = self.get_json(&format!("/v1/jobs/{id}?wait=0"))?;
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
                    self.get_json(&format!("/v1/jobs/{id}?wait={WAIT}"))?;
                }
                _ => std::thread::sleep(Duration::from_millis(120)),
            }
        }
    }

    pub fn get_json(&self, path: &str) -> Result<Value, CliError> {
        self.json(self.keyed(self.agent.get(self.url(path))).call())
    }

    pub fn get_bytes(&self, path: &str) -> Result<Vec<u8>, CliError> {
        let mut response =
            self.keyed(self.agent.get(self.url(path))).call().map_err(|error| self.unreachable(&error))?;
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
