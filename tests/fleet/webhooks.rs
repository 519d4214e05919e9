//! Webhooks: signed, retried, listed, and not lost with the server.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use crate::support::{Answer, Server, long, small};
use crate::{on_each_store, put};

/// A receiver that keeps what it was sent, and answers with the statuses it is given, the last for ever.
fn receiver(statuses: &'static [u16]) -> (String, mpsc::Receiver<(String, String)>) {
    receiver_towards("http://127.0.0.1:1/".into(), statuses)
}

/// One that says where else to go, too.
fn receiver_towards(elsewhere: String, statuses: &'static [u16]) -> (String, mpsc::Receiver<(String, String)>) {
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
            write!(stream, "HTTP/1.1 {status} X\r\ncontent-length: 0\r\nlocation: {elsewhere}\r\n\r\n").unwrap();
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

/// The server dies when the job has ended and its delivery is on its way; another process makes it again.
#[test]
fn an_event_is_delivered_across_a_kill() {
    on_each_store(|store| {
        let data = tempfile::tempdir().unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}/hook", listener.local_addr().unwrap());
        let arguments = [&["--webhook-allow", "127.0.0.1/32"], store].concat();
        let server = Server::start_with(data.path(), 1, &arguments);
        let made = server.post("/v1/webhooks", &json!({"url": address, "events": ["job.successful"]}));
        assert_eq!(made.status, 201);
        let id = server.submit(&small(1));
        // It is connected to and told, and says nothing.
        let (mut silent, _) = listener.accept().unwrap();
        let mut first = [0; 1];
        silent.read_exact(&mut first).unwrap();
        assert_eq!(server.get(&format!("/v1/jobs/{id}")).json()["status"], "successful");
        // SIGKILL.
        drop(server);
        let killed = Instant::now();
        let _server = Server::start_with(data.path(), 0, &arguments);
        let (mut stream, _) = listener.accept().unwrap();
        let mut text = [0; 4096];
        let read = stream.read(&mut text).unwrap();
        println!("{store:?}: delivered again {:?} after the kill", killed.elapsed());
        assert!(String::from_utf8_lossy(&text[..read]).contains("webhook-id: msg_"));
        assert!(killed.elapsed() < Duration::from_secs(40));
    });
}

/// A receiver that never answers keeps places from nobody else.
#[test]
fn a_slow_receiver_holds_nobody_else() {
    const JOBS: u64 = 24;
    let data = tempfile::tempdir().unwrap();
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, told) = receiver(&[200]);
    let server = Server::start_with(data.path(), 1, &["--webhook-allow", "127.0.0.1/32"]);
    // The silent one first: its deliveries are due before the other's.
    for url in [format!("http://{}/hook", silent.local_addr().unwrap()), address] {
        let made = server.post("/v1/webhooks", &json!({"url": url, "events": ["job.successful"]}));
        assert_eq!(made.status, 201);
    }
    let ids: Vec<String> = (0..JOBS).map(|seed| server.submit(&small(seed))).collect();
    for id in &ids {
        server.wait(id);
    }
    let ended = Instant::now();
    for _ in 0..JOBS {
        told.recv_timeout(Duration::from_secs(10)).unwrap();
    }
    println!("all were told {:?} after the last job", ended.elapsed());
    assert!(ended.elapsed() < Duration::from_secs(5));
}

/// The only delivery of a webhook, once a try has come to nothing.
fn tried(server: &Server, webhook: &Answer) -> Value {
    let begun = Instant::now();
    let retried = "mapfit_webhook_deliveries_total{outcome=\"retried\"} 1\n";
    while !String::from_utf8_lossy(&server.get("/metrics").body).contains(retried) {
        assert!(begun.elapsed() < Duration::from_secs(20), "it is not tried");
        std::thread::sleep(Duration::from_millis(20));
    }
    let path = format!("/v1/webhooks/{}/deliveries", webhook.json()["id"].as_str().unwrap());
    server.get(&path).json()["items"][0].clone()
}

/// Nobody is called who is not allowed: not by a redirect of one who is, nor by a name that means such an address.
#[test]
fn neither_redirects_nor_names_lead_to_others() {
    let data = tempfile::tempdir().unwrap();
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    silent.set_nonblocking(true).unwrap();
    let port = silent.local_addr().unwrap().port();
    // Allowed by its number, so that the redirect would be followed if any were.
    let (address, told) = receiver_towards(format!("http://127.0.0.1:{port}/"), &[302]);
    let hook = |server: &Server, url: &str| {
        let made = server.post("/v1/webhooks", &json!({"url": url, "events": ["job.successful"]}));
        assert_eq!(made.status, 201, "{}", String::from_utf8_lossy(&made.body));
        made
    };
    {
        let server = Server::start_with(data.path(), 1, &["--webhook-allow", "127.0.0.1/32"]);
        let redirected = hook(&server, &address);
        server.map_of(&small(1));
        told.recv_timeout(Duration::from_secs(10)).unwrap();
        let delivery = tried(&server, &redirected);
        assert_eq!((&delivery["status"], &delivery["attempts"]), (&json!("pending"), &json!(1)), "{delivery}");
        assert!(silent.accept().is_err(), "the redirect was followed");
    }
    let data = tempfile::tempdir().unwrap();
    let server = Server::start(data.path(), 1);
    // Not an address by its form; by what resolvers make of it, a loopback address.
    let named = hook(&server, &format!("http://127.1:{port}/hook"));
    server.map_of(&small(1));
    let delivery = tried(&server, &named);
    assert_eq!((&delivery["status"], &delivery["attempts"]), (&json!("pending"), &json!(1)), "{delivery}");
    assert!(silent.accept().is_err(), "it was called by a name");
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
