//! How the service meets what it should not serve: foreign names, bodies that are too large, fields it does not know.

mod support;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

use serde_json::json;
use support::{Server, small};

/// Sends a request as it is and gives what came back until the answer's end or two seconds of silence.
fn raw(server: &Server, request: &str) -> String {
    let mut stream = TcpStream::connect(server.url.trim_start_matches("http://")).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let (mut answer, mut buffer) = (Vec::new(), [0; 4096]);
    while let Ok(n @ 1..) = stream.read(&mut buffer) {
        answer.extend_from_slice(&buffer[..n]);
        if String::from_utf8_lossy(&answer).contains("request_id") {
            break;
        }
    }
    String::from_utf8_lossy(&answer).into_owned()
}

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
}

#[test]
fn pages_have_a_policy_and_data_is_private() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("kept");
    let server = Server::start(&data, 0);
    for page in ["/", "/docs/"] {
        let answer = server.get(page);
        let policy = answer.header("content-security-policy");
        assert!(answer.status == 200 && policy.contains("frame-ancestors 'none'") && !policy.contains('*'), "{policy}");
        assert_eq!(answer.header("x-content-type-options"), "nosniff");
    }
    assert_eq!(std::fs::metadata(&data).unwrap().permissions().mode() & 0o077, 0);
}

/// Sixty bodies of a few kilobytes that unpack to 64 MiB each, at once.
#[test]
fn packed_bodies_are_unpacked_a_few_at_a_time() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let mut body = small(1).to_string().into_bytes();
    body.resize((64 << 20) - 1, b' ');
    let bomb = zstd::encode_all(&body[..], 3).unwrap();
    assert!(bomb.len() < 100_000);
    let headers = [("content-type", "application/json"), ("content-encoding", "zstd")];
    std::thread::scope(|scope| {
        let all: Vec<_> =
            (0..60).map(|_| scope.spawn(|| server.send("POST", "/v1/jobs", &headers, Some(&bomb)).status)).collect();
        assert!(all.into_iter().all(|one| one.join().unwrap() == 202));
    });
    let peak = server.peak_memory() >> 20;
    println!("peak memory {peak} MiB");
    assert!(peak < 700, "{peak} MiB");
}

#[test]
fn a_connection_that_sends_no_header_is_closed() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let address = server.url.trim_start_matches("http://").to_owned();
    let silent: Vec<TcpStream> = (0..300).map(|_| TcpStream::connect(&address).unwrap()).collect();
    let mut slow = TcpStream::connect(&address).unwrap();
    slow.write_all(b"GET /livez HTTP/1.1\r\nHost: localh").unwrap();
    assert_eq!(server.get("/livez").status, 200, "three hundred idle connections keep nobody out");
    for mut stream in silent.into_iter().take(3).chain([slow]) {
        stream.set_read_timeout(Some(Duration::from_secs(45))).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("it is closed, not kept open");
    }
}

#[test]
fn readiness_is_a_write_that_succeeds() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    assert_eq!(server.get("/readyz").status, 200);
    // Another process holds the writer's lock, and lets it go again.
    let database = data.path().join("mapfit.sqlite");
    let (held, hold) = std::sync::mpsc::channel();
    let (release, released) = std::sync::mpsc::channel::<()>();
    let holder = std::thread::spawn(move || {
        tokio::runtime::Runtime::new().unwrap().block_on(async {
            use sqlx::Connection;
            let mut other =
                sqlx::sqlite::SqliteConnection::connect(&format!("sqlite://{}", database.display())).await.unwrap();
            let tx = other.begin_with("BEGIN IMMEDIATE").await.unwrap();
            held.send(()).unwrap();
            released.recv().unwrap();
            tx.rollback().await.unwrap();
        });
    });
    hold.recv().unwrap();
    std::thread::sleep(Duration::from_millis(1100));
    server.get("/readyz").problem(503);
    release.send(()).unwrap();
    holder.join().unwrap();
    let begun = Instant::now();
    while server.get("/readyz").status != 200 {
        assert!(begun.elapsed() < Duration::from_secs(20), "it is ready again without a restart");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn texts_are_compressed_where_the_client_says_so_and_files_are_not() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    server.send("GET", "/v1/jobs", &[("accept-encoding", "identity;q=0")], None).problem(406);
    for (path, encoding) in
        [("coefficients", "zstd"), ("contours", "zstd"), ("coefficients?format=npz", ""), ("image", "")]
    {
        let headers = [("accept-encoding", "zstd")];
        let answer = server.send("GET", &format!("{own}/{path}"), &headers, None);
        assert_eq!((answer.status, answer.header("content-encoding")), (200, encoding), "{path}");
        if encoding == "zstd" {
            assert_eq!(zstd::decode_all(&answer.body[..]).unwrap(), server.get(&format!("{own}/{path}")).body);
        }
    }
}

#[test]
fn what_a_crash_left_half_written_is_swept_and_an_ended_job_can_be_removed() {
    let data = tempfile::tempdir().unwrap();
    let left = data.path().join("artifacts/attempts/01900000-0000-7000-8000-000000000000/1");
    std::fs::create_dir_all(&left).unwrap();
    std::fs::write(left.join("map.npz#1"), b"half").unwrap();
    let probes = data.path().join("artifacts/probes");
    std::fs::create_dir_all(&probes).unwrap();
    // Of a process that died an hour ago, on whatever machine.
    let probe = std::fs::File::create(probes.join("01900000-0000-7000-8000-000000000000#1")).unwrap();
    probe.set_modified(std::time::SystemTime::now() - Duration::from_secs(3600)).unwrap();
    std::fs::create_dir_all(data.path().join("artifacts/attempts/empty")).unwrap();
    let server = Server::start(data.path(), 1);
    let begun = Instant::now();
    let names = |folder: &std::path::Path| std::fs::read_dir(folder).unwrap().count();
    while left.exists() || names(&probes) + names(&data.path().join("artifacts/attempts")) > 0 {
        assert!(begun.elapsed() < Duration::from_secs(10), "it is still there");
        std::thread::sleep(Duration::from_millis(50));
    }
    let map = server.map_of(&small(1));
    let job = server.get(&format!("/v1/maps/{map}")).json()["job_id"].as_str().unwrap().to_owned();
    server.delete(&format!("/v1/jobs/{job}?purge=true")).problem(409);
    assert_eq!(server.delete(&format!("/v1/maps/{map}")).status, 204);
    assert_eq!(server.delete(&format!("/v1/jobs/{job}?purge=true")).status, 204);
    server.get(&format!("/v1/jobs/{job}")).problem(404);
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

/// Twenty thousand scans of one beam, each of which may have crossed the whole lattice: no work that cannot be stopped.
#[test]
fn many_thin_scans_of_a_large_lattice_stop_when_they_are_told() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let pose = json!({"x": -1.0, "y": -1.0, "theta": std::f64::consts::FRAC_PI_4});
    let scan = json!({"pose": pose, "angle_min": 0.0, "angle_increment": 1e-6, "range_min": 0.1, "range_max": 30.0, "ranges": [13.9]});
    let mut job = small(1);
    job["scans"] = vec![scan; 20_000].into();
    job["map"] = json!({"distance": "vdf", "resolution": 0.02, "bounds": {"min": [0, 0], "max": [8.88, 8.88]}});
    let id = server.submit(&job);
    while server.get(&format!("/v1/jobs/{id}")).json()["status"] == "accepted" {
        std::thread::sleep(Duration::from_millis(50));
    }
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(server.delete(&format!("/v1/jobs/{id}")).status, 200);
    let began = Instant::now();
    server.map_of(&small(2));
    println!("the worker was free {:.1?} after the cancellation", began.elapsed());
    assert!(began.elapsed() < Duration::from_secs(8));
}

#[test]
fn labels_by_the_thousand_are_a_fault_not_a_failure() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    let query = vec!["label=a:b"; 2000].join("&");
    server.get(&format!("/v1/jobs?{query}")).problem(422);
}

/// Readers that ask for tens of megabytes and take nothing of it: they hold what the service allows, and no more.
#[test]
fn readers_that_take_nothing_hold_little_and_keep_nobody_out() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    let path = format!("/v1/maps/{}/query", server.map_of(&small(1)));
    let points: Vec<[f64; 2]> =
        (0..250_000).map(|k| [0.5 + f64::from(k % 500) * 0.013, 0.5 + f64::from(k / 500) * 0.013]).collect();
    let many = json!({"points": points});
    let whole = server.post(&path, &many);
    assert_eq!(whole.status, 200);
    let idle = server.peak_memory() >> 20;
    let address = server.url.trim_start_matches("http://").to_owned();
    let body = many.to_string();
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n",
        body.len()
    );
    let readers: Vec<TcpStream> = std::thread::scope(|scope| {
        let ask = || {
            let mut reader = TcpStream::connect(&address).unwrap();
            reader.write_all(head.as_bytes()).unwrap();
            reader.write_all(body.as_bytes()).unwrap();
            reader
        };
        let all: Vec<_> = (0..15).map(|_| scope.spawn(ask)).collect();
        all.into_iter().map(|one| one.join().unwrap()).collect()
    });
    let mut slowest = Duration::ZERO;
    for _ in 0..100 {
        let began = Instant::now();
        assert_eq!(server.post(&path, &json!({"points": [[1.0, 1.0]]})).status, 200);
        slowest = slowest.max(began.elapsed());
        std::thread::sleep(Duration::from_millis(100));
    }
    let peak = server.peak_memory() >> 20;
    println!(
        "an answer of {} MiB; peak {idle} MiB with one reader, {peak} MiB with fifteen that take nothing; slowest question {slowest:.1?}",
        whole.body.len() >> 20
    );
    assert!(peak < idle + 256, "{peak} MiB");
    drop(readers);
    let begun = Instant::now();
    while server.post(&path, &many).status != 200 {
        assert!(begun.elapsed() < Duration::from_secs(40), "what they held comes back");
    }
}

#[test]
fn readiness_asked_in_bulk_is_one_answer() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 0);
    for _ in 0..3 {
        std::thread::scope(|scope| {
            let all: Vec<_> = (0..40).map(|_| scope.spawn(|| server.get("/readyz").status)).collect();
            assert!(all.into_iter().all(|one| one.join().unwrap() == 200));
        });
        std::thread::sleep(Duration::from_millis(1100));
    }
}
