//! A client of the service, for the commands that speak to one: what any other client does, over HTTP.

use std::time::Duration;

use serde_json::Value;
use ureq::http::Uri;

use super::CliError;

/// Where a service is, unless it is said.
const HERE: &str = "http://127.0.0.1:8080";
/// Answers larger than this are not read.
const LARGEST_ANSWER: u64 = 1 << 30;

pub struct Client {
    agent: ureq::Agent,
    base: String,
    /// An `Authorization` header, where the service wants a key.
    authorization: Option<String>,
}

/// Under what its flags stand in a command's help.
const SERVER: &str = "Server";

/// Which service, and by what key.
#[derive(Debug, clap::Args)]
pub struct Remote {
    /// The server; `http://` may be left out.
    #[arg(long, env = "MAPFIT_URL", default_value = HERE, value_parser = address, global = true, help_heading = SERVER)]
    url: String,
    /// An API key, where the server wants one.
    #[arg(long, env = "MAPFIT_KEY", hide_env_values = true, global = true, help_heading = SERVER)]
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
        let base = with_scheme(base);
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

    /// What a command needs to speak to the same service; nothing where that is the one it would speak to.
    pub fn as_argument(&self) -> String {
        if self.base == HERE { String::new() } else { format!(" --url {}", self.base) }
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
        match status.as_u16() {
            200..300 => Ok(value),
            // What was sent is at fault, and will be whenever it is sent again.
            400 | 401 | 403 | 413 | 414 | 415 | 422 => Err(CliError::Usage(complaint(&value))),
            _ => Err(CliError::Server(complaint(&value))),
        }
    }

    fn unreachable(&self, error: &ureq::Error) -> CliError {
        let hint = match self.base.starts_with("https") {
            true => "Is `mapfit serve` running there, with --tls-cert? Without it the address begins with http://",
            false => "Is `mapfit serve` running there?",
        };
        CliError::Unreachable(format!("{} cannot be reached: {error}. {hint}", self.base))
    }
}

fn with_scheme(address: &str) -> String {
    if address.contains("://") { address.to_owned() } else { format!("http://{address}") }
}

/// An address as `--url` takes it.
fn address(text: &str) -> Result<String, String> {
    let whole = with_scheme(text.trim_end_matches('/').trim_end_matches("/v1"));
    let wrong = || "must be a server's address, like localhost:8080 or https://maps.example.org".to_owned();
    let uri: Uri = whole.parse().map_err(|_| wrong())?;
    let authority = uri.authority().ok_or_else(wrong)?;
    // A port that is no number up to 65535 is left out where it is read.
    let has_port = authority.as_str().trim_end_matches(|c: char| c.is_ascii_digit()).ends_with(':');
    let is_whole = !authority.host().is_empty() && has_port == authority.port_u16().is_some();
    let is_http = matches!(uri.scheme_str(), Some("http" | "https"));
    if is_whole && is_http && uri.query().is_none() { Ok(whole) } else { Err(wrong()) }
}

/// A problem in words: with its faults where it lists them, which its detail only repeats.
fn complaint(problem: &Value) -> String {
    let faults = problem["errors"].as_array().map(Vec::as_slice).unwrap_or_default();
    let mut words = match faults {
        [] => format!("{}: {}", text(problem, "title"), text(problem, "detail")),
        _ => text(problem, "title"),
    };
    for fault in faults.iter().take(20) {
        let place = fault["pointer"].as_str().or(fault["parameter"].as_str()).unwrap_or("");
        words.push_str(&format!("\n  {place} {}", text(fault, "detail")));
    }
    words
}

pub(super) fn text(value: &Value, member: &str) -> String {
    value[member].as_str().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_may_lack_its_scheme_and_nothing_else() {
        for (given, meant) in [
            ("localhost:8080", "http://localhost:8080"),
            ("[::1]:8080/", "http://[::1]:8080"),
            ("https://maps.example.org/fleet/", "https://maps.example.org/fleet"),
            ("http://localhost:8080/v1", "http://localhost:8080"),
        ] {
            assert_eq!(address(given).as_deref(), Ok(meant));
        }
        for wrong in ["", "ftp://localhost", "http://", "local host", "localhost:99999", "localhost:", "localhost?a=b"]
        {
            assert!(address(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_problem_says_each_fault_once() {
        let fault = serde_json::json!({"pointer": "/map/resolution", "detail": "is too fine"});
        let problem =
            serde_json::json!({"title": "Invalid", "detail": "/map/resolution: is too fine", "errors": [fault]});
        assert_eq!(complaint(&problem), "Invalid\n  /map/resolution is too fine");
        let gone = serde_json::json!({"title": "Not found", "detail": "there is no job 7"});
        assert_eq!(complaint(&gone), "Not found: there is no job 7");
    }
}
