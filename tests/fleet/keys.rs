//! Keys, tenants, scopes, rates and quotas: who may call what, and how often.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};

use crate::JSON;
use crate::support::{Answer, Server, small};

/// Runs `mapfit keys ...` on a data folder; its output.
fn keys(data: &Path, arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_mapfit"))
        .args(["keys", "--log", "warn"])
        .args(arguments)
        .arg("--data")
        .arg(data)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn key(data: &Path, tenant: &str, scopes: &str) -> String {
    let printed = keys(data, &["create", "--tenant", tenant, "--scopes", scopes]);
    format!("Bearer {}", printed.lines().last().unwrap())
}

#[test]
fn a_key_opens_what_its_scopes_say_and_its_tenant_has() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let open = server.map_of(&small(1));
    // From here on nobody comes in without a key, and whatever Host they name.
    let all = key(data.path(), "a", "read,submit,admin");
    let narrow = key(data.path(), "a", "read");
    let other = key(data.path(), "b", "read,submit,admin");
    let send = |method: &str, path: &str, key: &str, body: Option<Value>| {
        let body = body.map(|body| body.to_string());
        server.send(
            method,
            path,
            &[("authorization", key), ("host", "maps.example"), JSON],
            body.as_deref().map(str::as_bytes),
        )
    };
    let refused = server.get("/v1/jobs");
    refused.problem(401);
    assert!(refused.header("www-authenticate").starts_with("Bearer"));
    for wrong in ["", "Bearer", "Bearer mapfit_0000000000000000_x", "Basic dXNlcjpwYXNz", &all[..all.len() - 1]] {
        send("GET", "/v1/jobs", wrong, None).problem(401);
    }
    assert_eq!(send("GET", "/v1/jobs", &all.replace("Bearer", "bearer"), None).status, 200);
    assert_eq!(send("GET", &format!("/v1/maps/{open}"), &all, None).status, 404, "it is the default tenant's");
    for path in ["/livez", "/readyz", "/openapi.json", "/"] {
        assert_eq!(server.get(path).status, 200, "{path}");
    }
    send("POST", "/v1/jobs", &narrow, Some(small(2))).problem(403);
    let submitted = send("POST", "/v1/jobs", &all, Some(small(2)));
    assert_eq!(submitted.status, 202);
    let id = submitted.json()["id"].as_str().unwrap().to_owned();
    let done = send("GET", &format!("/v1/jobs/{id}?wait=60"), &narrow, None).json();
    assert_eq!(done["status"], "successful");
    let map = done["map_id"].as_str().unwrap();
    for path in [format!("/v1/jobs/{id}"), format!("/v1/jobs/{id}/events"), format!("/v1/maps/{map}/poses")] {
        send("GET", &path, &other, None).problem(404);
    }
    assert_eq!(send("GET", "/v1/jobs", &other, None).json()["items"], json!([]));
    send("DELETE", &format!("/v1/maps/{map}"), &narrow, None).problem(403);
    send("DELETE", &format!("/v1/maps/{map}"), &other, None).problem(404);
    send("PUT", "/v1/places/hall", &narrow, Some(json!({"map_id": map}))).problem(403);
    send("PUT", "/v1/places/hall", &other, Some(json!({"map_id": map}))).problem(422);
    assert_eq!(send("PUT", "/v1/places/hall", &all, Some(json!({"map_id": map}))).status, 201);
    send("GET", "/v1/places/hall", &other, None).problem(404);

    // A key that is revoked opens nothing, at once; and the keys are nowhere.
    let id = all["Bearer mapfit_".len()..][..16].to_owned();
    keys(data.path(), &["revoke", &id]);
    send("GET", "/v1/jobs", &all, None).problem(401);
    let listed = keys(data.path(), &["list"]);
    assert!(listed.contains("revoked") && !listed.contains(&all["Bearer ".len()..]));
    for entry in std::fs::read_dir(data.path()).unwrap().flatten().filter(|entry| entry.path().is_file()) {
        let bytes = std::fs::read(entry.path()).unwrap();
        let secret = all.rsplit('_').next().unwrap().as_bytes();
        assert!(!bytes.windows(secret.len()).any(|window| window == secret), "{:?}", entry.path());
    }
}

/// Every route of the document, and whom it lets in: what is not in this list nobody may call.
#[test]
fn the_golden_list_says_who_may_call_what() {
    let data = tempfile::tempdir().unwrap();
    key(data.path(), "a", "read");
    let server = Server::start(data.path(), 0);
    let by_scope: Vec<(&str, String)> =
        ["read", "submit", "admin"].map(|scope| (scope, key(data.path(), "a", scope))).into();
    let document = server.get("/openapi.json").json();
    let golden = include_str!("../fixtures/who_may_call_what.txt");
    let mut listed = String::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for method in item.as_object().unwrap().keys().map(|method| method.to_uppercase()) {
            let operation = &item[method.to_lowercase()];
            let needs = operation["security"][0]["key"][0].as_str().unwrap_or("nothing");
            listed.push_str(&format!("{method:<7}{path} {needs}\n"));
            if !path.starts_with("/v1") {
                assert_eq!(needs, "nothing");
                continue;
            }
            let tile = path.replace("{layer}/{z}/{x}/{y}", "sigma/3/0/-1");
            let address = tile.replace("{id}", "x").replace("{name}", "x").replace("{part}", "poses");
            server.send(&method, &address, &[], None).problem(401);
            server
                .send(&method, &address, &[("authorization", "Bearer mapfit_0000000000000000_AAAA")], None)
                .problem(401);
            for (scope, key) in &by_scope {
                let answer = server.send(&method, &address, &[("authorization", key), JSON], Some(b"{}"));
                let told = format!("{method} {path} with {scope}: {}", answer.status);
                assert_eq!(answer.status == 403, *scope != needs, "{told}");
                assert_ne!(answer.status, 401, "{told}");
            }
        }
    }
    assert_eq!(listed, golden, "tests/fixtures/who_may_call_what.txt");
}

#[test]
fn a_service_that_others_reach_needs_a_key() {
    let data = tempfile::tempdir().unwrap();
    let serve = |data: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command.args(["serve", "--listen", "0.0.0.0:0", "--workers", "0", "--log", "error", "--data"]).arg(data);
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap()
    };
    let output = serve(data.path()).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("mapfit keys create"));
    key(data.path(), "a", "read");
    let mut child = serve(data.path());
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.starts_with("serving on http://0.0.0.0:"), "{line}");
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn requests_are_counted_a_key_and_jobs_a_tenant() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 0, &["--rate-limit", "5", "--quota-queued", "2"]);
    let answers: Vec<Answer> = (0..12).map(|_| server.get("/v1/usage")).collect();
    assert!(answers[0].header("ratelimit").starts_with("\"requests\";r="));
    assert_eq!(answers[0].header("ratelimit-policy"), "\"requests\";q=5;w=1");
    let over = answers.iter().find(|answer| answer.status == 429).expect("the limit is five a second");
    over.problem(429);
    assert_eq!(over.header("retry-after"), "1");
    assert_eq!(server.get("/livez").status, 200, "health is not counted");
    std::thread::sleep(Duration::from_millis(1100));
    let (first, second) = (server.submit(&small(1)), server.submit(&small(2)));
    let over = server.post("/v1/jobs", &small(3));
    assert_eq!(over.problem(429)["type"], "/problems/over-quota");
    assert!(!over.header("retry-after").is_empty());
    std::thread::sleep(Duration::from_millis(1100));
    let usage = server.get("/v1/usage").json();
    assert_eq!(usage["queued_jobs"], json!({"used": 2, "limit": 2}));
    // Nothing of it is lost: what was accepted waits.
    for id in [first, second] {
        assert_eq!(server.get(&format!("/v1/jobs/{id}")).json()["status"], "accepted");
    }
}
