//! What is refused, and in which words.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::raw;
use crate::support::{Server, small};

#[test]
fn only_loopback_names_and_pages_are_served() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    for (host, origin, status) in [
        ("evil.example", "", 403),
        ("127.0.0.1.evil.example:80", "", 403),
        ("localhost:9", "", 200),
        ("[::1]:9", "", 200),
        ("localhost", "Origin: https://evil.example\r\n", 403),
        ("localhost", "Origin: null\r\n", 403),
        ("localhost", "Origin: http://localhost:5173\r\n", 200),
    ] {
        let answer =
            raw(&server, &format!("GET /v1/jobs HTTP/1.1\r\nHost: {host}\r\n{origin}Connection: close\r\n\r\n"));
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{host} {origin}: {answer}");
    }
    let rebound = "DELETE /v1/maps/01900000-0000-7000-8000-000000000000 HTTP/1.1\r\nHost: evil.example\r\n\r\n";
    assert!(raw(&server, rebound).starts_with("HTTP/1.1 403"));
    let twice = "GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    assert!(raw(&server, twice).starts_with("HTTP/1.1 400"));
    let absolute = "GET http://evil.example/v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    assert!(raw(&server, absolute).starts_with("HTTP/1.1 403"), "the target wins over Host");
}

#[test]
fn what_is_too_large_or_misdirected_is_refused_before_it_is_read() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let post = |path: &str, media: &str, length: u64| {
        let began = Instant::now();
        let head = format!(
            "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {media}\r\nContent-Length: {length}\r\n\r\n{{"
        );
        let answer = raw(&server, &head);
        assert!(began.elapsed() < Duration::from_secs(1), "{path} took {:?}", began.elapsed());
        answer
    };
    assert!(post("/v1/jobs", "application/json", 10_000_000_000).starts_with("HTTP/1.1 413"));
    assert!(post("/v1/jobs", "text/csv", 1_000).starts_with("HTTP/1.1 415"));
    let nowhere = "/v1/maps/01900000-0000-7000-8000-000000000000/query";
    assert!(post(nowhere, "application/json", 1_000).starts_with("HTTP/1.1 404"));
}

#[test]
fn unknown_fields_and_parameters_are_faults_that_name_them() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let mut job = small(1);
    (job["prioritty"], job["fit"], job["map"]["a/b"]) = (json!(3), json!({"iterations": 3}), json!(1));
    let problem = server.post("/v1/jobs", &job).problem(422);
    let pointers: Vec<&str> =
        problem["errors"].as_array().unwrap().iter().map(|fault| fault["pointer"].as_str().unwrap()).collect();
    assert_eq!(pointers.len(), 3, "{problem}");
    for pointer in ["/prioritty", "/fit/iterations", "/map/a~1b"] {
        assert!(pointers.contains(&pointer), "{pointer} is not in {pointers:?}");
    }
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    for path in ["/v1/jobs?stat=running", "/v1/maps?offset=3", &format!("{own}/ogm?res=0.1"), &format!("{own}?x=1")] {
        let problem = server.get(path).problem(422);
        assert!(problem["errors"][0]["parameter"].is_string(), "{problem}");
    }
    let problem = server.post(&format!("{own}/query"), &json!({"points": [[0, 0]], "point": 1})).problem(422);
    assert_eq!(problem["errors"][0]["pointer"], "/point");
    for (method, path, body, wrong) in [
        ("PUT", "/v1/places/hall", json!({"map": "x", "note": 3}), vec!["/map", "/map_id", "/note"]),
        ("POST", "/v1/places/hall/rollback", json!({"version": "one"}), vec!["/version"]),
        (
            "POST",
            "/v1/webhooks",
            json!({"url": "https://x.example", "events": ["job.lost"], "a/b": 1}),
            vec!["/a~1b", "/events"],
        ),
        ("POST", "/v1/webhooks", json!([]), vec![""]),
    ] {
        let answer =
            server.send(method, path, &[("content-type", "application/json")], Some(body.to_string().as_bytes()));
        let problem = answer.problem(422);
        let pointers: Vec<&str> =
            problem["errors"].as_array().unwrap().iter().map(|fault| fault["pointer"].as_str().unwrap()).collect();
        assert_eq!(pointers, wrong, "{method} {path}: {problem}");
    }
}

/// What has no business being large is refused as such, packed or not.
#[test]
fn a_webhook_or_a_label_is_no_place_for_megabytes() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let long = json!({"labels": {"a": "x".repeat(1 << 20)}}).to_string();
    let packed = zstd::encode_all(long.as_bytes(), 3).unwrap();
    assert!(packed.len() < 1000);
    for (method, path) in
        [("PATCH", "/v1/jobs/x"), ("PATCH", "/v1/maps/x"), ("POST", "/v1/webhooks"), ("PUT", "/v1/places/x")]
    {
        let plain = [("content-type", "application/json")];
        server.send(method, path, &plain, Some(long.as_bytes())).problem(413);
        let encoded = [("content-type", "application/json"), ("content-encoding", "zstd")];
        server.send(method, path, &encoded, Some(&packed)).problem(413);
    }
}

/// A header of a hundred bytes that takes its reader for ever must not take an answer's turn with it.
#[test]
fn a_nested_npy_header_is_refused_at_once() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let path = format!("/v1/maps/{}/query", server.map_of(&small(1)));
    let npy = |header: &str| {
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
        file.extend(header.as_bytes());
        file
    };
    let began = Instant::now();
    for header in
        [format!("{}{}\n", "[".repeat(40), "]".repeat(40)), format!("{{'shape': ({},)}}\n", "9".repeat(60_000))]
    {
        let body = npy(&header);
        server.send("POST", &path, &[("content-type", "application/x-npy")], Some(&body)).problem(422);
    }
    let mut plain = npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2), }\n");
    plain.extend([1.0f64, 1.0].iter().flat_map(|value| value.to_le_bytes()));
    let answer = server.send("POST", &path, &[("content-type", "application/x-npy")], Some(&plain));
    assert_eq!(answer.json()["distance"].as_array().unwrap().len(), 1);
    assert!(began.elapsed() < Duration::from_secs(5));
}

#[test]
fn labels_by_the_thousand_are_a_fault_not_a_failure() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let query = vec!["label=a:b"; 2000].join("&");
    server.get(&format!("/v1/jobs?{query}")).problem(422);
}

/// What never becomes a request, because its head cannot be read, has a problem as its answer all the same.
#[test]
fn what_is_no_request_is_told_so_in_words() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let long = "x".repeat(100_000);
    let many = (0..150).map(|k| format!("X-{k}: y\r\n")).collect::<String>();
    for (request, status, slug) in [
        ("GET /livez HTTP/1.1\r\nHost: localhost\r\nbad header\r\n\r\n".to_owned(), 400, "bad-request"),
        ("{\"scans\": []}\r\n\r\n".into(), 400, "bad-request"),
        ("GET /livez HTTP/3.7\r\nHost: localhost\r\n\r\n".into(), 400, "bad-request"),
        (format!("GET /livez HTTP/1.1\r\nHost: localhost\r\nX-Long: {long}\r\n\r\n"), 431, "too-large"),
        (format!("GET /livez HTTP/1.1\r\nHost: localhost\r\n{many}\r\n"), 431, "too-large"),
    ] {
        let shown = &request[..request.len().min(60)];
        let answer = raw(&server, &request);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{shown}: {answer}");
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        let field =
            |name: &str| head.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": ")).unwrap_or("");
        assert_eq!(field("content-type"), "application/problem+json", "{shown}");
        assert_eq!((field("content-length"), field("connection")), (&*body.len().to_string(), "close"), "{shown}");
        let problem: Value = serde_json::from_str(body).unwrap();
        assert_eq!((&problem["status"], &problem["type"]), (&json!(status), &json!(format!("/problems/{slug}"))));
        assert_eq!(problem["request_id"], field("x-request-id"));
    }
    let both = raw(&server, "GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\nnonsense\r\n\r\n");
    assert!(both.starts_with("HTTP/1.1 200") && both.contains("HTTP/1.1 400"), "{both}");
    assert_eq!(server.get("/livez").status, 200);
}
