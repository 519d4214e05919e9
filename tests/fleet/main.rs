//! What a fleet's server relies on: keys and tenants, places, webhooks, quotas, second tries.

mod jobs;
mod keys;
mod logs;
mod places;
#[path = "../support/postgres.rs"]
mod postgres_server;
mod quotas;
mod retention;
mod strangers;
#[path = "../support/mod.rs"]
mod support;
mod views;
mod webhooks;

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use support::{Answer, Server};

/// A server that logs into a file.
fn logging(data: &Path, log: &Path, arguments: &[&str]) -> Server {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
    command.args(["serve", "--listen", "127.0.0.1:0", "--workers", "1"]).args(arguments).arg("--data").arg(data);
    command.stderr(std::fs::File::create(log).unwrap());
    Server::start_command(command)
}

/// What the promises of a store are held to: arguments of `serve`, on SQLite and on PostgreSQL.
fn on_each_store(test: impl Fn(&[&str])) {
    test(&[]);
    test(&["--database-url", &postgres_server::database()]);
}

const JSON: (&str, &str) = ("content-type", "application/json");

fn put(server: &Server, name: &str, body: &Value, headers: &[(&str, &str)]) -> Answer {
    let headers: Vec<_> = headers.iter().copied().chain([JSON]).collect();
    server.send("PUT", &format!("/v1/places/{name}"), &headers, Some(body.to_string().as_bytes()))
}
