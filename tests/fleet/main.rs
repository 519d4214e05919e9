//! What a fleet's server relies on: keys and tenants, places, webhooks, quotas, second tries.

mod jobs;
mod keys;
mod places;
mod retention;
#[path = "../support/mod.rs"]
mod support;
mod views;
mod webhooks;

use serde_json::Value;
use support::{Answer, Server};

const JSON: (&str, &str) = ("content-type", "application/json");

fn put(server: &Server, name: &str, body: &Value, headers: &[(&str, &str)]) -> Answer {
    let headers: Vec<_> = headers.iter().copied().chain([JSON]).collect();
    server.send("PUT", &format!("/v1/places/{name}"), &headers, Some(body.to_string().as_bytes()))
}
