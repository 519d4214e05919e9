//! What a fleet's server relies on: keys and tenants, places, webhooks, quotas, second tries.

mod support;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use support::{Answer, Server, long, small};

const JSON: (&str, &str) = ("content-type", "application/json");

fn put(server: &Server, name: &str, body: &Value, headers: &[(&str, &str)]) -> Answer {
    let headers: Vec<_> = headers.iter().copied().chain([JSON]).collect();
    server.send("PUT", &format!("/v1/places/{name}"), &headers, Some(body.to_string().as_bytes()))
}

#[test]
fn a_place_has_the_map_that_was_published_last() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let (one, two) = (server.map_of(&small(1)), server.map_of(&small(2)));
    let first = put(&server, "hall", &json!({"map_id": one, "note": "first"}), &[("if-none-match", "*")]);
    assert_eq!((first.status, first.json()["version"].as_i64()), (201, Some(1)));
    let place = first.json();
    assert_eq!((&place["name"], &place["map_id"], &place["note"]), (&json!("hall"), &json!(one), &json!("first")));
    assert_eq!(place["sha256"].as_str().unwrap().len(), 64);
    put(&server, "hall", &json!({"map_id": two}), &[("if-none-match", "*")]).problem(412);
    put(&server, "hall", &json!({"map_id": two}), &[("if-match", "\"p0\"")]).problem(412);
    let second = put(&server, "hall", &json!({"map_id": two}), &[("if-match", first.header("etag"))]);
    assert_eq!((second.status, second.json()["version"].as_i64()), (200, Some(2)));
    put(&server, "hall", &json!({"map_id": one}), &[("if-match", first.header("etag"))]).problem(412);
    put(&server, "Hall", &json!({"map_id": one}), &[]).problem(422);
    assert_eq!(put(&server, "hall", &json!({"map_id": "x"}), &[]).problem(422)["errors"][0]["pointer"], "/map_id");
    put(&server, "hall", &json!({"map_id": one, "x": 1}), &[]).problem(422);

    let got = server.get("/v1/places/hall");
    assert_eq!((got.json()["map_id"].as_str(), got.header("etag")), (Some(&two[..]), second.header("etag")));
    let known = [("if-none-match", second.header("etag"))];
    assert_eq!(server.send("GET", "/v1/places/hall", &known, None).status, 304);
    assert_eq!(server.get("/v1/places").json()["items"][0]["name"], "hall");
    let pages = server.get("/v1/places/hall/versions?limit=1").json();
    assert_eq!(pages["items"][0]["version"], 2);
    let cursor = pages["next_cursor"].as_str().unwrap();
    let rest = server.get(&format!("/v1/places/hall/versions?cursor={cursor}")).json();
    assert_eq!((&rest["items"][0]["version"], &rest["next_cursor"]), (&json!(1), &Value::Null));

    // The redirect is followed here; the map's own address shows in its body.
    assert_eq!(server.get("/v1/places/hall/map").json()["id"], two);
    assert_eq!(server.get("/v1/places/hall/map/coefficients?format=npz").header("content-type"), "application/x-npz");
    server.get("/v1/places/hall/map/%1E%C3%BA%2F..%2F").problem(404);
    server.delete(&format!("/v1/maps/{two}")).problem(409);

    let back = server.post("/v1/places/hall/rollback", &json!({"version": 1}));
    assert_eq!((back.status, &back.json()["version"], &back.json()["map_id"]), (200, &json!(3), &json!(one)));
    assert_eq!(
        server.post("/v1/places/hall/rollback", &json!({"version": 9})).problem(422)["errors"][0]["pointer"],
        "/version"
    );
    server.post("/v1/places/nowhere/rollback", &json!({"version": 1})).problem(404);
    server.delete(&format!("/v1/maps/{two}")).problem(409);
    assert_eq!(server.delete("/v1/places/hall").status, 204);
    server.get("/v1/places/hall").problem(404);
    assert_eq!(server.delete(&format!("/v1/maps/{two}")).status, 204);
}

/// A robot that waits hears of a publication at once, of nothing in time, and of what it does not know right away.
#[test]
fn a_robot_waits_for_the_next_map() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let map = server.map_of(&small(1));
    let tag = put(&server, "hall", &json!({"map_id": map}), &[]).header("etag").to_owned();
    let began = Instant::now();
    assert_eq!(server.send("GET", "/v1/places/hall?wait=1", &[("if-none-match", &tag)], None).status, 304);
    assert!(began.elapsed() >= Duration::from_secs(1));
    assert_eq!(server.get("/v1/places/hall?wait=30").status, 200);
    std::thread::scope(|scope| {
        let waits = scope.spawn(|| {
            let answer = server.send("GET", "/v1/places/hall?wait=30", &[("if-none-match", &tag)], None);
            (answer.json()["version"].as_i64(), Instant::now())
        });
        std::thread::sleep(Duration::from_millis(400));
        put(&server, "hall", &json!({"map_id": map}), &[]);
        let published = Instant::now();
        let (version, heard) = waits.join().unwrap();
        assert_eq!(version, Some(2));
        let late = heard.saturating_duration_since(published);
        println!("heard after {late:?}");
        assert!(late < Duration::from_millis(200), "{late:?}");
    });
    server.get("/v1/places/hall?wait=61").problem(422);
}

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
    let golden = include_str!("fixtures/who_may_call_what.txt");
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

#[test]
fn a_dry_run_says_what_a_map_would_be_and_keeps_nothing() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let dry = server.post("/v1/jobs?dry_run=true", &small(1));
    assert_eq!(dry.status, 200);
    let dry = dry.json();
    assert_eq!(server.get("/v1/jobs").json()["items"], json!([]));
    let map = server.map_of(&small(1));
    let map = server.get(&format!("/v1/maps/{map}")).json();
    assert_eq!(dry["lattice"], map["lattice"]);
    assert!(dry["control_points"].as_u64().unwrap() > 0 && dry["returns"].as_u64().unwrap() > 0);
    assert!(dry["estimate"]["seconds"].as_f64().unwrap() > 0.0 && dry["estimate"]["bytes"].as_u64().unwrap() > 0);
    let mut bad = small(1);
    bad["map"]["resolution"] = json!(-1);
    assert_eq!(server.post("/v1/jobs?dry_run=true", &bad).problem(422)["errors"][0]["pointer"], "/map/resolution");
    server.post("/v1/jobs?dry_run=maybe", &small(1)).problem(422);
}

#[test]
fn an_ended_job_is_tried_again_and_relabelled() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let mut job = small(1);
    job["labels"] = json!({"site": "hq"});
    let id = server.submit(&job);
    let first = server.wait(&id);
    let again = server.post(&format!("/v1/jobs/{id}/retry"), &json!({}));
    assert_eq!(
        (again.status, &again.json()["retry_of"], &again.json()["labels"]),
        (202, &json!(id), &json!({"site": "hq"}))
    );
    assert_eq!(again.header("location"), format!("/v1/jobs/{}", again.json()["id"].as_str().unwrap()));
    let second = server.wait(again.json()["id"].as_str().unwrap());
    let coefficients =
        |job: &Value| server.get(&format!("/v1/maps/{}/coefficients", job["map_id"].as_str().unwrap())).body;
    assert_eq!(coefficients(&first), coefficients(&second));
    assert_eq!((&first["retry_of"], &first["parts"]), (&Value::Null, &Value::Null));

    let map = format!("/v1/maps/{}", first["map_id"].as_str().unwrap());
    let tag = server.get(&map).header("etag").to_owned();
    let patch = |path: &str, body: &Value| server.send("PATCH", path, &[JSON], Some(body.to_string().as_bytes()));
    let changed = patch(&map, &json!({"name": "hall", "labels": {"site": "lab"}}));
    assert_eq!((&changed.json()["name"], &changed.json()["labels"]), (&json!("hall"), &json!({"site": "lab"})));
    let got = server.send("GET", &map, &[("if-none-match", &tag)], None);
    assert_eq!((got.status, &got.json()["name"]), (200, &json!("hall")), "its tag has changed");
    assert_eq!(server.get("/v1/maps?label=site:lab").json()["items"].as_array().unwrap().len(), 1);
    assert_eq!(patch(&format!("/v1/jobs/{id}"), &json!({"labels": {}})).json()["labels"], json!({}));
    assert_eq!(patch(&map, &json!({"labels": {"a": 1}})).problem(422)["errors"][0]["pointer"], "/labels/a");
    assert_eq!(patch(&map, &json!({"distance": "sdf"})).problem(422)["errors"][0]["pointer"], "/distance");
    patch("/v1/maps/x", &json!({})).problem(404);
    server.signal("-STOP");
    server.signal("-CONT");
    server.post("/v1/jobs/x/retry", &json!({})).problem(404);
}

#[test]
fn a_deadline_or_a_time_limit_ends_a_job() {
    let data = tempfile::tempdir().unwrap();
    {
        let server = Server::start(data.path(), 0);
        let mut late = small(1);
        late["deadline_seconds"] = json!(0.5);
        let id = server.submit(&late);
        server.post(&format!("/v1/jobs/{id}/retry"), &json!({})).problem(409);
        let job = server.wait(&id);
        assert_eq!((&job["status"], &job["problem"]["type"]), (&json!("failed"), &json!("/problems/deadline-passed")));
        late["deadline_seconds"] = json!(0);
        assert_eq!(server.post("/v1/jobs", &late).problem(422)["errors"][0]["pointer"], "/deadline_seconds");
    }
    let server = Server::start_with(data.path(), 1, &["--job-seconds", "1"]);
    let job = server.wait(&server.submit(&long(1)));
    assert_eq!((&job["status"], &job["problem"]["type"]), (&json!("failed"), &json!("/problems/job-too-long")));
}

#[test]
fn what_the_service_does_shows_in_its_metrics() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    server.map_of(&small(1));
    server.get("/v1/maps/x").problem(404);
    let answer = server.get("/metrics");
    assert!(answer.header("content-type").starts_with("text/plain; version=0.0.4"));
    let text = String::from_utf8(answer.body).unwrap();
    let value = |name: &str| -> f64 {
        let line = text.lines().find(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(' ')));
        line.unwrap_or_else(|| panic!("{name} in {text}")).rsplit(' ').next().unwrap().parse().unwrap()
    };
    assert_eq!(value("mapfit_attempts_total{outcome=\"successful\"}"), 1.0);
    assert_eq!((value("mapfit_maps"), value("mapfit_jobs{state=\"accepted\"}")), (1.0, 0.0));
    assert!(value("mapfit_map_bytes") > 1000.0 && value("process_resident_memory_bytes") > 1e6);
    assert_eq!(value("mapfit_stage_seconds_count{distance=\"sdf\",stage=\"covariance\"}"), 1.0);
    let by_route = "mapfit_http_request_seconds_count{method=\"GET\",route=\"/v1/maps/{id}\",status=\"404\"}";
    assert_eq!(value(by_route), 1.0, "by the route's pattern, so that ids make no series");

    let apart = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let server = Server::start_with(&data.path().join("other"), 0, &["--metrics-listen", &apart]);
    server.get("/metrics").problem(404);
    let mut stream = std::net::TcpStream::connect(&apart).unwrap();
    write!(stream, "GET /metrics HTTP/1.1\r\nHost: {apart}\r\nConnection: close\r\n\r\n").unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    assert!(text.starts_with("HTTP/1.1 200") && text.contains("mapfit_queue_oldest_seconds"));
}

#[test]
fn tiles_fit_together_and_show_what_was_observed() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let map = server.map_of(&small(1));
    for layer in ["distance", "sigma", "clearance", "occupancy"] {
        let tile = server.get(&format!("/v1/maps/{map}/tiles/{layer}/7/0/0?theme=dark"));
        assert_eq!((tile.status, tile.header("content-type")), (200, "image/png"), "{layer}");
        assert_eq!(&tile.body[..8], b"\x89PNG\r\n\x1a\n");
        let known = [("if-none-match", tile.header("etag"))];
        let again = server.send("GET", &format!("/v1/maps/{map}/tiles/{layer}/7/0/0?theme=dark"), &known, None);
        assert_eq!(again.status, 304);
    }
    let pixels = |path: &str| {
        let tile = server.get(&format!("/v1/maps/{map}/tiles/{path}"));
        let mut reader = png::Decoder::new(std::io::Cursor::new(tile.body)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    };
    // A quarter of a tile is one of the next level: its lower left pixels show the same places, four to one.
    let (coarse, fine) = (pixels("sigma/7/0/0"), pixels("sigma/8/0/0"));
    let at = |pixels: &[u8], column: usize, row: usize| -> [u8; 4] {
        pixels[4 * (column + 256 * row)..][..4].try_into().unwrap()
    };
    let mut alike = 0;
    for (column, row) in (0..128).flat_map(|column| (0..128).map(move |row| (column, row))) {
        let (one, four) = (at(&coarse, column, row + 128), at(&fine, 2 * column, 2 * row + 1));
        alike += usize::from(one.iter().zip(four).all(|(a, b)| a.abs_diff(b) < 24));
    }
    assert!(alike > 128 * 128 * 95 / 100, "{alike}");
    assert!(pixels("distance/7/-9/40").iter().all(|value| *value == 0), "nothing was observed there");
    for path in ["sigma/15/0/0", "sigma/3/0/x", "other/3/0/0", "sigma/3/99999999999/0"] {
        server.get(&format!("/v1/maps/{map}/tiles/{path}")).problem(404);
    }
    server.get(&format!("/v1/maps/{map}/tiles/sigma/3/0/0?max=0")).problem(422);
}

/// A receiver that keeps what it was sent, and answers with the statuses it is given, the last for ever.
fn receiver(statuses: &'static [u16]) -> (String, mpsc::Receiver<(String, String)>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/hook", listener.local_addr().unwrap());
    let (tell, told) = mpsc::channel();
    std::thread::spawn(move || {
        for (k, stream) in listener.incoming().enumerate() {
            let mut stream = stream.unwrap();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            let (mut head, mut length) = (String::new(), 0);
            while !head.ends_with("\r\n\r\n") && reader.read_line(&mut head).unwrap() > 0 {}
            for line in head.to_lowercase().lines() {
                length = line.strip_prefix("content-length: ").map_or(length, |text| text.parse().unwrap());
            }
            let mut body = vec![0; length];
            reader.read_exact(&mut body).unwrap();
            let status = statuses[k.min(statuses.len() - 1)];
            write!(stream, "HTTP/1.1 {status} X\r\ncontent-length: 0\r\nlocation: http://127.0.0.1:1/\r\n\r\n")
                .unwrap();
            if tell.send((head, String::from_utf8(body).unwrap())).is_err() {
                return;
            }
        }
    });
    (address, told)
}

fn header<'a>(head: &'a str, name: &str) -> &'a str {
    let lines = head.lines().filter_map(|line| line.split_once(": "));
    lines.filter(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value).next().unwrap()
}

#[test]
fn webhooks_are_signed_retried_and_listed() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 1, &["--webhook-allow", "127.0.0.1/32"]);
    let (address, told) = receiver(&[500, 200]);
    let secret = format!("whsec_{}", STANDARD.encode([7; 32]));
    let hook = json!({"url": address, "events": ["job.successful", "place.published"], "secret": secret});
    let made = server.post("/v1/webhooks", &hook);
    assert_eq!((made.status, &made.json()["secret"]), (201, &json!(secret)));
    let path = format!("/v1/webhooks/{}", made.json()["id"].as_str().unwrap());
    assert!(server.get(&path).json()["secret"].is_null(), "it is shown once");
    let map = server.map_of(&small(1));
    let (first, payload) = told.recv_timeout(Duration::from_secs(10)).unwrap();
    let (second, again) = told.recv_timeout(Duration::from_secs(15)).unwrap();
    assert_eq!(payload, again);
    assert_eq!(header(&first, "webhook-id"), header(&second, "webhook-id"));
    let event: Value = serde_json::from_str(&payload).unwrap();
    assert_eq!((&event["type"], &event["data"]["map_id"]), (&json!("job.successful"), &json!(map)));
    let seconds: u64 = header(&second, "webhook-timestamp").parse().unwrap();
    let signed =
        mapfit::worker::webhooks::signature(&secret, header(&second, "webhook-id"), seconds, &payload).unwrap();
    assert_eq!(header(&second, "webhook-signature"), signed);
    put(&server, "hall", &json!({"map_id": map}), &[]);
    let (_, payload) = told.recv_timeout(Duration::from_secs(10)).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&payload).unwrap()["data"]["name"], "hall");
    let begun = Instant::now();
    let all = loop {
        let all = server.get(&format!("{path}/deliveries")).json()["items"].clone();
        if all[0]["status"] == "delivered" || begun.elapsed() > Duration::from_secs(5) {
            break all;
        }
    };
    assert_eq!((&all[0]["event"], &all[1]["event"]), (&json!("place.published"), &json!("job.successful")));
    assert_eq!(
        (&all[1]["status"], &all[1]["attempts"], &all[1]["next_attempt"]),
        (&json!("delivered"), &json!(2), &Value::Null)
    );
    assert_eq!(server.delete(&path).status, 204);
    server.get(&path).problem(404);
}

/// A delivery that was due when the server was killed is made by the next one.
#[test]
fn an_event_outlives_the_server() {
    let data = tempfile::tempdir().unwrap();
    let (address, told) = receiver(&[200]);
    let server = Server::start_with(data.path(), 1, &["--webhook-allow", "10.0.0.0/8"]);
    let refused = server.post("/v1/webhooks", &json!({"url": address, "events": ["job.successful"]}));
    assert_eq!(refused.problem(422)["errors"][0]["pointer"], "/url");
    // A name that means a loopback address is found out when it is called, and never connected to.
    let by_name = address.replace("127.0.0.1", "localtest.invalid");
    assert_eq!(server.post("/v1/webhooks", &json!({"url": by_name, "events": ["job.successful"]})).status, 201);
    server.map_of(&small(1));
    drop(server);
    assert!(told.try_recv().is_err());
    let server = Server::start_with(data.path(), 1, &["--webhook-allow", "127.0.0.1/32"]);
    let made = server.post("/v1/webhooks", &json!({"url": address, "events": ["job.dismissed"]}));
    assert_eq!(made.status, 201);
    let id = server.submit(&long(1));
    server.delete(&format!("/v1/jobs/{id}"));
    drop(server);
    let _server = Server::start_with(data.path(), 0, &["--webhook-allow", "127.0.0.1/32"]);
    let (_, payload) = told.recv_timeout(Duration::from_secs(90)).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&payload).unwrap()["data"]["id"], id);
}
