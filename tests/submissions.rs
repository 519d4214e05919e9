//! What durability costs: a thousand jobs through HTTP, against the same database writing as many rows, one commit each.
//!
//! `cargo test --release --test submissions -- --ignored --nocapture --test-threads 1`. Where the disk is the limit
//! it is far above what it asks (2.96 and 1.43 times at 400 to 475 bare rows a second); where the disk is quick (4,000 rows) the cores are, which
//! clients, service and database share.

#[path = "support/postgres.rs"]
mod postgres_server;
mod support;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use sqlx::{Connection, Executor};
use support::{Server, small};

const JOBS: usize = 1000;
const CLIENTS: usize = 16;
/// Of the rate at which bare rows are committed one by one, what submissions must reach.
const SHARE: f64 = 0.6;

/// A job of three scans.
fn three_scans() -> String {
    let mut job = small(1);
    job["scans"].as_array_mut().unwrap().truncate(3);
    assert_eq!(job["scans"].as_array().unwrap().len(), 3);
    job.to_string()
}

fn a_second(count: usize, time: Duration) -> f64 {
    count as f64 / time.as_secs_f64()
}

/// Rows a second of a plain table in the same database, with the same promise, a commit each.
macro_rules! bare {
    ($connection:expr) => {{
        $connection.execute("CREATE TABLE bare (id TEXT PRIMARY KEY, request TEXT NOT NULL)").await.unwrap();
        let began = Instant::now();
        for k in 0..JOBS {
            let insert = format!("INSERT INTO bare VALUES ('{k}', '{}')", "x".repeat(1000));
            $connection.execute(sqlx::AssertSqlSafe(insert)).await.unwrap();
        }
        a_second(JOBS, began.elapsed())
    }};
}

/// A connection that is kept, and takes as little of the cores as can be: they are the service's, too.
struct Client {
    stream: BufReader<TcpStream>,
    host: String,
}

impl Client {
    fn of(server: &Server) -> Self {
        let host = server.url.strip_prefix("http://").unwrap().to_owned();
        Self { stream: BufReader::new(TcpStream::connect(&host).unwrap()), host }
    }

    /// Submits a job, which must be taken.
    fn submit(&mut self, key: &str, body: &str) {
        let (host, length) = (&self.host, body.len());
        let request = format!(
            "POST /v1/jobs HTTP/1.1\r\nhost: {host}\r\ncontent-type: application/json\r\nidempotency-key: {key}\r\n\
             content-length: {length}\r\n\r\n{body}"
        );
        self.stream.get_mut().write_all(request.as_bytes()).unwrap();
        let (mut line, mut length) = (String::new(), 0);
        self.stream.read_line(&mut line).unwrap();
        assert!(line.starts_with("HTTP/1.1 202"), "{line}");
        while line != "\r\n" {
            line.clear();
            self.stream.read_line(&mut line).unwrap();
            if let Some(value) = line.to_ascii_lowercase().strip_prefix("content-length:") {
                length = value.trim().parse().unwrap();
            }
        }
        self.stream.read_exact(&mut vec![0; length]).unwrap();
    }
}

/// Jobs that a crowd of clients submits.
fn submitted(server: &Server, clients: usize, jobs: usize) -> f64 {
    let body = three_scans();
    let mut crowd: Vec<Client> = (0..clients).map(|_| Client::of(server)).collect();
    let began = Instant::now();
    std::thread::scope(|scope| {
        for (k, client) in crowd.iter_mut().enumerate() {
            let body = &body;
            scope.spawn(move || {
                (0..jobs / clients).for_each(|job| client.submit(&format!("{clients} {k} {job}"), body))
            });
        }
    });
    a_second(jobs / clients * clients, began.elapsed())
}

fn judge(name: &str, bare: f64, server: &Server) {
    let alone = submitted(server, 1, JOBS / 4);
    // The first of a crowd find connections not open yet, and statements not prepared.
    let cold = submitted(server, CLIENTS + 1, JOBS / 4);
    let crowd = submitted(server, CLIENTS, JOBS);
    let times = |rate: f64| format!("{rate:.0} jobs a second ({:.2} times)", rate / bare);
    println!(
        "{name}: {bare:.0} bare rows a second, {} of {CLIENTS} clients, {} of the first, {} of one",
        times(crowd),
        times(cold),
        times(alone)
    );
    assert!(crowd >= SHARE * bare, "{name}: {crowd:.0} jobs a second, and {bare:.0} bare rows");
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "nightly: a measurement, for a machine that does nothing else"]
async fn submissions_keep_pace_with_sqlite() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bare.sqlite");
    let options = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(&file)
        .create_if_missing(true)
        .journal_mode(sqlx::sqlite::SqliteJournalMode::Wal)
        .synchronous(sqlx::sqlite::SqliteSynchronous::Full);
    let mut connection = sqlx::sqlite::SqliteConnection::connect_with(&options).await.unwrap();
    let rate = bare!(connection);
    let data = folder.path().join("data");
    tokio::task::spawn_blocking(move || judge("SQLite", rate, &Server::start(&data, 0))).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "nightly: a measurement, for a machine that does nothing else"]
async fn submissions_keep_pace_with_postgresql() {
    let url = postgres_server::database();
    let mut connection = sqlx::postgres::PgConnection::connect(&url).await.unwrap();
    let rate = bare!(connection);
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().to_owned();
    tokio::task::spawn_blocking(move || {
        let server = Server::start_with(&data, 0, &["--database-url", &url]);
        judge("PostgreSQL", rate, &server);
    })
    .await
    .unwrap();
}
