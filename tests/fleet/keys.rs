//! Keys: who may call what.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::JSON;
use crate::support::{Server, small};

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

/// A new key, as a request has it.
pub fn key(data: &Path, tenant: &str, scopes: &str) -> String {
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

    // A key that is revoked opens nothing, at once.
    let id = all["Bearer mapfit_".len()..][..16].to_owned();
    keys(data.path(), &["revoke", &id]);
    send("GET", "/v1/jobs", &all, None).problem(401);
    let listed = keys(data.path(), &["list"]);
    assert!(listed.contains("revoked") && !listed.contains(&all["Bearer ".len()..]));
}

/// Every route of the document, and whom it lets in: what is not in this list nobody may call.
#[test]
fn the_golden_list_says_who_may_call_what() {
    let data = tempfile::tempdir().unwrap();
    key(data.path(), "a", "read");
    let server = Server::start(data.path(), 0);
    let revoked = key(data.path(), "a", "read,submit,admin");
    keys(data.path(), &["revoke", &revoked["Bearer mapfit_".len()..][..16]]);
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
            for shut in ["Bearer mapfit_0000000000000000_AAAA", &revoked] {
                server.send(&method, &address, &[("authorization", shut)], None).problem(401);
            }
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
