//! What becomes of a submitted job: its address at once, or a bar until it has ended, and then what its map is.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::CliError;
use super::bar::{Bar, Standing};
use super::client::{Client, text};
use super::interrupt::Interrupt;
use super::summary::summary;

/// How often a job is looked at where somebody sees the bar.
const LOOK: Duration = Duration::from_millis(150);
/// Elsewhere an answer comes when the job has ended, or after this many seconds.
const WAIT: &str = "2";
/// How often the service is asked how many jobs wait.
const ASK: Duration = Duration::from_secs(2);

/// How to tell of jobs.
pub struct Follow<'a> {
    pub client: &'a Client,
    /// Until they have ended.
    pub wait: bool,
    /// As a line of JSON a job.
    pub json: bool,
}

impl Follow<'_> {
    /// Tells of a job by what it was made of, and of its map where that is waited for; the map then. `notes` is what was
    /// to be said of how the job came about.
    pub fn job(&self, what: &str, notes: &[String], job: Value) -> Result<Option<Value>, CliError> {
        let client = self.client;
        let id = text(&job, "id");
        let goes_on = format!("job {id} goes on without this command; {}", how_to_follow(client, &id));
        // Before anything is printed: whoever read the job's address may press Ctrl-C.
        let _interrupt = self.wait.then(|| Interrupt::says(goes_on.clone()));
        if !self.json {
            println!("{what}: job {}", client.url(&text(&job["links"], "self")));
        }
        if let Some(message) = job["message"].as_str() {
            eprintln!("{what}: {message}");
        }
        if !self.wait {
            self.line(&job, &Value::Null);
            return Ok(None);
        }
        let job = ended(client, job).map_err(|error| match error {
            CliError::Unreachable(why) => CliError::Unreachable(format!("{why}\n{goes_on}")),
            other => other,
        })?;
        if let Some(error) = failure(&job) {
            self.line(&job, &Value::Null);
            return Err(error);
        }
        let map = client.get_json(&text(&job["links"], "map"))?;
        self.line(&job, &map);
        if !self.json {
            println!("{what}: map {}", client.url(&text(&map["links"], "self")));
            print!("{}", summary(&map, notes));
            for (relation, address) in map["links"].as_object().into_iter().flatten() {
                println!("  {relation:<13}{}", client.url(address.as_str().unwrap_or_default()));
            }
        }
        Ok(Some(map))
    }

    fn line(&self, job: &Value, map: &Value) {
        if self.json {
            println!("{}", json!({"job": job, "map": map}));
        }
    }
}

/// Waits for a job to end, with a bar on a terminal.
pub fn ended(client: &Client, job: Value) -> Result<Value, CliError> {
    let id = text(&job, "id");
    let mut bar = Bar::new();
    let mut queue = Queue { client, asked: None, waiting: None };
    loop {
        let wait = if bar.is_hidden() { WAIT } else { "0" };
        let job = client.get_json(&format!("/v1/jobs/{id}?wait={wait}"))?;
        match text(&job, "status").as_str() {
            "successful" | "failed" | "dismissed" => return Ok(job),
            _ if bar.is_hidden() => continue,
            "accepted" => bar.says(0.0, queue.words()),
            _ => {
                let progress = &job["progress"];
                let step = progress["iteration"].as_u64().unwrap_or(0);
                let percent = progress["percent"].as_f64().unwrap_or(0.0);
                bar.show(Standing { percent, stage: progress["stage"].as_str().unwrap_or_default(), step });
            }
        }
        std::thread::sleep(LOOK);
    }
}

/// Why an ended job has no map.
pub fn failure(job: &Value) -> Option<CliError> {
    let id = text(job, "id");
    match text(job, "status").as_str() {
        "failed" => {
            let problem = &job["problem"];
            let (title, detail) = (text(problem, "title"), text(problem, "detail"));
            Some(CliError::Server(format!("job {id} failed: {title}: {detail}")))
        }
        "dismissed" => Some(CliError::Server(format!("job {id} was cancelled"))),
        _ => None,
    }
}

fn how_to_follow(client: &Client, id: &str) -> String {
    let server = client.as_argument();
    format!("`mapfit jobs wait {id}{server}` follows it, `mapfit cancel {id}{server}` ends it")
}

/// What is known of the queue: how many jobs of the tenant wait. Where in it one job stands the service does not say.
struct Queue<'a> {
    client: &'a Client,
    asked: Option<Instant>,
    waiting: Option<u64>,
}

impl Queue<'_> {
    fn words(&mut self) -> String {
        if self.asked.is_none_or(|at| at.elapsed() >= ASK) {
            let usage = self.client.get_json("/v1/usage").unwrap_or_default();
            (self.asked, self.waiting) = (Some(Instant::now()), usage["queued_jobs"]["used"].as_u64());
        }
        match self.waiting {
            Some(waiting) if waiting > 1 => format!("waiting for a worker: one of {waiting} jobs that wait"),
            _ => "waiting for a worker".into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_job_says_why_and_a_successful_one_nothing() {
        let failed = json!({"id": "7", "status": "failed", "problem": {"title": "No map", "detail": "no returns"}});
        assert_eq!(
            failure(&failed).map(|error| error.to_string()).as_deref(),
            Some("job 7 failed: No map: no returns")
        );
        assert!(failure(&json!({"id": "7", "status": "dismissed"})).is_some());
        assert!(failure(&json!({"id": "7", "status": "successful"})).is_none());
    }

    #[test]
    fn what_follows_a_job_names_the_server_it_is_on() {
        let told = |url: &str| how_to_follow(&Client::new(url, None), "7");
        assert!(told("localhost:9000").contains("`mapfit cancel 7 --url http://localhost:9000`"));
        assert!(told("http://127.0.0.1:8080").contains("`mapfit jobs wait 7`"));
    }
}
