//! Many at once: those who ask much, send nothing, or take nothing.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::connect;
use crate::support::{Server, small};

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
        "an answer of {} MiB; peak {idle} MiB with one reader, {peak} MiB with fifteen that take nothing; \
         slowest question {slowest:.1?}",
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

/// Whether a connection was closed with bytes on it that nobody had read.
fn hung_up(error: &std::io::Error) -> bool {
    matches!(error.kind(), std::io::ErrorKind::ConnectionReset | std::io::ErrorKind::BrokenPipe)
}

/// Thirty clients that begin with bodies of sixty megabytes and do not end them.
#[test]
fn unfinished_bodies_hold_what_may_be_held_and_keep_nobody_out() {
    const SENT: usize = 60 << 20;
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 0, &["--request-seconds", "20"]);
    let idle = server.peak_memory() >> 20;
    let begin = || {
        let mut client = connect(&server);
        let length = SENT + 1;
        let head = format!(
            "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n\
             Content-Length: {length}\r\n\r\n"
        );
        client.write_all(head.as_bytes()).unwrap();
        let piece = vec![b' '; 1 << 20];
        let sent = (0..SENT / piece.len()).try_for_each(|_| client.write_all(&piece));
        assert!(sent.as_ref().map_or_else(hung_up, |()| true), "{sent:?}");
        client
    };
    let clients: Vec<TcpStream> = std::thread::scope(|scope| {
        let all: Vec<_> = (0..30).map(|_| scope.spawn(begin)).collect();
        all.into_iter().map(|one| one.join().unwrap()).collect()
    });
    let began = Instant::now();
    assert_eq!(server.post("/v1/jobs", &small(1)).status, 202);
    assert!(began.elapsed() < Duration::from_secs(1), "a small job took {:?}", began.elapsed());
    let peak = server.peak_memory() >> 20;
    println!("idle {idle} MiB, peak {peak} MiB with thirty unfinished bodies");
    assert!(peak < idle + 256, "{idle} MiB, then {peak} MiB");
    for mut client in clients {
        client.set_read_timeout(Some(Duration::from_secs(40))).unwrap();
        let mut answer = [0; 12];
        match client.read(&mut answer) {
            Ok(told) => {
                assert!(
                    told == 0 || answer[..told].starts_with(b"HTTP/1.1 408"),
                    "{:?}",
                    answer[..told].escape_ascii()
                );
            }
            Err(error) => assert!(hung_up(&error), "it is answered or closed, not kept open: {error}"),
        }
    }
}

#[test]
fn a_connection_beyond_the_limit_waits_for_a_place() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 0, &["--connections", "8"]);
    let mut idle: Vec<TcpStream> = (0..8).map(|_| connect(&server)).collect();
    let mut ninth = connect(&server);
    ninth.write_all(b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    ninth.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
    let waits = ninth.read(&mut [0; 1]).expect_err("there is no place");
    assert_eq!(waits.kind(), std::io::ErrorKind::WouldBlock);
    drop(idle.pop());
    ninth.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let mut answer = String::new();
    ninth.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
}

/// A request of spaces is kept in a few kilobytes, and a join may name its map many times.
#[test]
fn a_join_of_padded_requests_is_refused_before_they_are_unpacked() {
    let data = tempfile::tempdir().unwrap();
    let server = Server::start_with(data.path(), 1, &["--memory", "1024"]);
    let mut body = small(1).to_string().into_bytes();
    body.resize((64 << 20) - 1, b' ');
    let bomb = zstd::encode_all(&body[..], 3).unwrap();
    let headers = [("content-type", "application/json"), ("content-encoding", "zstd")];
    let job = server.send("POST", "/v1/jobs", &headers, Some(&bomb));
    assert_eq!(job.status, 202);
    let map = server.wait(job.json()["id"].as_str().unwrap())["map_id"].clone();
    let before = server.peak_memory() >> 20;
    let maps = vec![json!({"id": map, "pose": {"x": 0, "y": 0, "theta": 0}}); 64];
    let join = json!({"maps": maps, "map": {"resolution": 0.5}});
    for path in ["/v1/joins", "/v1/joins?dry_run=true"] {
        let problem = server.post(path, &join).problem(422);
        assert_eq!(problem["errors"][0]["pointer"], "/maps", "{problem}");
    }
    let peak = server.peak_memory() >> 20;
    println!("peak memory {before} MiB before, {peak} MiB after");
    assert!(peak < before + 64, "{before} MiB, then {peak} MiB");
}
