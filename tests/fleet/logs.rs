//! The log: a line an event, without colours in a file, and found by the ids that clients have.

use serde_json::{Value, json};

use crate::support::{Server, small};
use crate::{JSON, logging};

/// What a service logs by itself of a job that is fitted, and of an answer that fails because the map's file is gone.
struct Told {
    log: String,
    job: String,
    /// The request's id of the failed answer.
    failed: String,
}

fn told(format: &str) -> Told {
    let data = tempfile::tempdir().unwrap();
    let log = data.path().join("log.txt");
    let server: Server = logging(data.path(), &log, &["--log-format", format]);
    let body = small(1).to_string();
    let submitted = server.send("POST", "/v1/jobs", &[JSON, ("x-request-id", "robot-7")], Some(body.as_bytes()));
    assert_eq!((submitted.status, submitted.header("x-request-id")), (202, "robot-7"));
    let job = submitted.json()["id"].as_str().unwrap().to_owned();
    let map = server.wait(&job)["map_id"].as_str().unwrap().to_owned();
    std::fs::remove_dir_all(data.path().join("artifacts/attempts")).unwrap();
    let failed = server.get(&format!("/v1/maps/{map}/coefficients")).problem(500);
    assert_eq!(failed["type"], "/problems/artifact-missing");
    drop(server);
    let failed = failed["request_id"].as_str().unwrap().to_owned();
    Told { log: std::fs::read_to_string(log).unwrap(), job, failed }
}

#[test]
fn a_log_of_objects_is_found_by_job_and_request() {
    let Told { log, job, failed } = told("json");
    let lines: Vec<Value> =
        log.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect();
    assert!(lines.iter().all(|line| line["level"].is_string() && line["timestamp"].is_string()), "{log}");
    let says = |message: &str| {
        let line = lines.iter().find(|line| line["message"] == message);
        line.unwrap_or_else(|| panic!("{message} is not in {log}"))
    };
    let accepted = says("accepted");
    assert_eq!((&accepted["job"], &accepted["span"]["request_id"]), (&json!(job), &json!("robot-7")));
    assert_eq!((&says("attempt begins")["job"], &says("attempt ends")["job"]), (&json!(job), &json!(job)));
    let error = says("a request failed");
    assert_eq!(
        (&error["level"], &error["status"], &error["problem"]),
        (&json!("ERROR"), &json!(500), &json!("artifact-missing"))
    );
    // Why is in the log alone, under the same id.
    let why = says("an artifact is missing");
    assert!(why["error"].as_str().unwrap().contains("attempts/"), "{why}");
    assert_eq!((&error["span"]["request_id"], &why["span"]["request_id"]), (&json!(failed), &json!(failed)));
    assert!(!log.contains('\u{1b}') && !log.contains("\\u001b"), "no colours: {log}");
}

#[test]
fn a_log_of_text_is_found_by_job_and_request() {
    let Told { log, job, failed } = told("text");
    let line = |words: &[&str]| {
        let found = log.lines().any(|line| words.iter().all(|word| line.contains(word)));
        assert!(found, "{words:?} are in no line of {log}");
    };
    line(&["accepted", &job, "robot-7"]);
    line(&["attempt begins", &job]);
    line(&["ERROR", "a request failed", "artifact-missing", &failed]);
    line(&["ERROR", "an artifact is missing", &failed]);
    assert!(!log.contains('\u{1b}'), "no colours: {log}");
}
