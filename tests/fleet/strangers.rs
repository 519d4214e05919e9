//! What those may not learn or do who have no key, or another tenant's.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::keys::key;
use crate::support::{Answer, Server, small};
use crate::{JSON, logging};

/// Every file below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Whatever is done with them: keys are in no file of the service, and no secret is in its log at its most talkative.
#[test]
fn a_key_is_nowhere_on_disk_or_in_a_log() {
    let (data, logs) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let log = logs.path().join("log.txt");
    let server = logging(data.path(), &log, &["--log", "trace"]);
    let keys: Vec<String> =
        ["read", "submit", "read,submit,admin"].map(|scopes| key(data.path(), "a", scopes)).to_vec();
    let mut misspelt = keys[2].clone();
    misspelt.replace_range(misspelt.len() - 4.., "zzzz");
    let send = |method: &str, path: &str, key: &str, body: Option<Value>| {
        let body = body.map(|body| body.to_string());
        server.send(method, path, &[("authorization", key), JSON], body.as_deref().map(str::as_bytes))
    };
    send("POST", "/v1/jobs", &misspelt, Some(small(1))).problem(401);
    let id = send("POST", "/v1/jobs", &keys[1], Some(small(1))).json()["id"].as_str().unwrap().to_owned();
    let job = send("GET", &format!("/v1/jobs/{id}?wait=60"), &keys[0], None).json();
    let map = job["map_id"].as_str().unwrap();
    assert_eq!(send("GET", &format!("/v1/maps/{map}/image"), &keys[0], None).status, 200);
    assert_eq!(send("PUT", "/v1/places/hall", &keys[2], Some(json!({"map_id": map}))).status, 201);
    let signing = "whsec_c2VjcmV0LW9mLWEtd2ViaG9vay0xMjM0NTY3ODkw";
    let hook = json!({"url": "https://robots.example/", "events": ["job.failed"], "secret": signing});
    assert_eq!(send("POST", "/v1/webhooks", &keys[2], Some(hook)).status, 201);
    drop(server);
    let secrets: Vec<&str> = keys.iter().chain([&misspelt]).map(|key| key.splitn(3, '_').last().unwrap()).collect();
    assert!(secrets.iter().all(|secret| secret.len() == 43), "256 bits in base64");
    let has = |file: &Path, secret: &str| contains(&std::fs::read(file).unwrap(), secret.as_bytes());
    let kept = files(data.path());
    assert!(kept.len() > 1 && std::fs::metadata(&log).unwrap().len() > 10_000, "{kept:?}");
    for secret in &secrets {
        assert!(kept.iter().chain([&log]).all(|file| !has(file, secret)), "{secret}");
    }
    // What deliveries are signed with is kept, for nothing can be signed with a digest of it; and never logged.
    assert!(!has(&log, &signing["whsec_".len()..]));
    assert!(has(&log, &id), "the log is what was looked at");
}

fn contains(bytes: &[u8], text: &[u8]) -> bool {
    bytes.windows(text.len()).any(|window| window == text)
}

/// A stranger may not even make the service wait for a body.
#[test]
fn a_stranger_is_refused_before_the_body() {
    let data = tempfile::tempdir().unwrap();
    let known = key(data.path(), "a", "submit");
    let server = Server::start(data.path(), 0);
    let begin = |authorization: &str| {
        let mut stream = TcpStream::connect(server.url.trim_start_matches("http://")).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        write!(
            stream,
            "POST /v1/jobs HTTP/1.1\r\nHost: maps.example\r\nContent-Type: application/json\r\n\
             Content-Length: 60000000\r\n{authorization}\r\n"
        )
        .unwrap();
        stream
    };
    let narrow = key(data.path(), "a", "read");
    for (authorization, status) in [
        (String::new(), 401),
        ("Authorization: Bearer mapfit_0000000000000000_AAAA\r\n".to_owned(), 401),
        (format!("Authorization: {}\r\n", &known[..known.len() - 1]), 401),
        (format!("Authorization: {narrow}\r\n"), 403),
    ] {
        let (mut stream, begun) = (begin(&authorization), Instant::now());
        let mut head = [0; 12];
        stream.read_exact(&mut head).unwrap();
        assert_eq!(String::from_utf8_lossy(&head), format!("HTTP/1.1 {status}"), "{authorization}");
        assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
    }
    let mut stream = begin(&format!("Authorization: {known}\r\n"));
    stream.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
    assert!(stream.read_exact(&mut [0; 12]).is_err(), "whoever has a key is waited for");
}

/// Whoever is refused while they still send has their answer, and a connection that goes on.
#[test]
fn a_refused_body_is_thrown_away() {
    let data = tempfile::tempdir().unwrap();
    key(data.path(), "a", "submit");
    let server = Server::start(data.path(), 0);
    let mut stream = TcpStream::connect(server.url.trim_start_matches("http://")).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let mut answered = |sent: &[u8]| {
        stream.write_all(sent).unwrap();
        let (mut head, mut byte) = (Vec::new(), [0]);
        while !head.ends_with(b"\r\n\r\n") {
            stream.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        let head = String::from_utf8(head).unwrap().to_lowercase();
        let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")).unwrap();
        stream.read_exact(&mut vec![0; length.parse().unwrap()]).unwrap();
        head[9..12].to_owned()
    };
    const LENGTH: usize = 5_000_000;
    let head = format!(
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: {LENGTH}\r\n\r\n"
    );
    assert_eq!(answered(head.as_bytes()), "401");
    let rest = [&vec![b' '; LENGTH][..], b"GET /livez HTTP/1.1\r\nHost: x\r\n\r\n"].concat();
    assert_eq!(answered(&rest), "200");
}

/// What another tenant has is not there, by whichever route it is asked for, and stays as it is.
#[test]
fn ids_of_another_tenant_are_unknown_everywhere() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let [own, foreign] = ["a", "b"].map(|tenant| key(data.path(), tenant, "read,submit,admin"));
    let send = |method: &str, path: &str, key: &str, body: &Value| {
        server.send(method, path, &[("authorization", key), JSON], Some(body.to_string().as_bytes()))
    };
    let get = |path: &str, key: &str| server.send("GET", path, &[("authorization", key)], None);
    let text = |answer: Answer, member: &str| answer.json()[member].as_str().unwrap().to_owned();
    let job = text(send("POST", "/v1/jobs", &own, &small(1)), "id");
    let map = text(get(&format!("/v1/jobs/{job}?wait=60"), &own), "map_id");
    assert_eq!(send("PUT", "/v1/places/hall", &own, &json!({"map_id": map})).status, 201);
    let hook = json!({"url": "https://robots.example/", "events": ["job.failed"]});
    let hook = text(send("POST", "/v1/webhooks", &own, &hook), "id");
    let everything = || {
        let lists = ["jobs", "maps", "places", "places/hall/versions", "webhooks"];
        lists.map(|list| get(&format!("/v1/{list}"), &own).body)
    };
    let before = everything();

    let scans = json!({"scans": small(2)["scans"], "noise": small(2)["noise"]});
    let body_of = |path: &str| match path.rsplit('/').next().unwrap() {
        "query" => json!({"points": [[1.0, 1.0]]}),
        "localize" | "updates" => scans.clone(),
        "rollback" => json!({"version": 1}),
        "{name}" => json!({"map_id": map}),
        _ => json!({}),
    };
    let document = server.get("/openapi.json").json();
    let mut routes = 0;
    for (path, item) in document["paths"].as_object().unwrap().iter().filter(|(path, _)| path.contains('{')) {
        let id = [("/v1/jobs", &job), ("/v1/maps", &map), ("/v1/webhooks", &hook), ("/v1/places", &map)];
        let (_, id) = id.into_iter().find(|(room, _)| path.starts_with(room)).unwrap();
        let address = path.replace("{layer}/{z}/{x}/{y}", "sigma/3/0/-1").replace("{name}", "hall");
        let mut address = address.replace("{id}", id).replace("{part}", "poses");
        if path.ends_with("/changes") {
            address += &format!("?since={map}");
        }
        for method in item.as_object().unwrap().keys().map(|method| method.to_uppercase()) {
            routes += 1;
            let ask = |key: &str| match &method[..] {
                "GET" => get(&address, key),
                "DELETE" => server.send("DELETE", &address, &[("authorization", key)], None),
                method => send(method, &address, key, &body_of(path)),
            };
            let answer = ask(&foreign);
            // A place's name is everybody's own; the map that is to be published there is not.
            let expected = if method == "PUT" { 422 } else { 404 };
            let told = String::from_utf8_lossy(&answer.body).into_owned();
            assert_eq!(answer.status, expected, "{method} {path}: {told}");
            if method == "GET" {
                assert_ne!(ask(&own).status, 404, "{method} {path} is there for its owner");
            }
        }
    }
    assert!(routes >= 35, "{routes}");
    let maps = json!({"maps": [{"map_id": map}, {"map_id": map, "pose": {"x": 0, "y": 0, "theta": 0}}],
                      "map": {"distance": "sdf", "resolution": 0.5}});
    assert!([404, 422].contains(&send("POST", "/v1/joins", &foreign, &maps).status));
    assert_eq!(get("/v1/jobs", &foreign).json()["items"], json!([]));
    assert!(everything() == before, "nothing of it has changed");
}
