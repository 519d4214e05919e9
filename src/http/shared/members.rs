//! Small JSON bodies: an object of a few members, of which every fault is named.
//!
//! serde ends at the first fault and does not say where it is. The members are told once more, beside the type that
//! serde reads, and each is read by itself: what is unknown, missing or wrong has its pointer.

use axum::body::Body;
use axum::http::{HeaderMap, StatusCode};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::negotiate::JSON;
use super::problem::Problem;
use super::state::Service;
use crate::jobs::Fault;

/// Unknown members that are listed.
const MOST_FAULTS: usize = 100;

/// A member: its name, whether it has to be there, and how it is read.
pub type Member = (&'static str, bool, fn(&Value) -> serde_json::Result<()>);

/// A body of such members.
pub trait Members: DeserializeOwned {
    const MEMBERS: &'static [Member];
}

/// Reads a member's value, to see whether it is one.
pub fn reads<T: DeserializeOwned>(value: &Value) -> serde_json::Result<()> {
    T::deserialize(value).map(drop)
}

impl Service {
    /// A small JSON body.
    pub async fn read_small<T: Members>(&self, headers: &HeaderMap, body: Body) -> Result<T, Problem> {
        read(&self.read_few(headers, body, &[JSON.media]).await?)
    }
}

fn read<T: Members>(bytes: &[u8]) -> Result<T, Problem> {
    // Deep nesting is refused by serde_json itself, which reads no deeper than 128 levels.
    let value: Value = serde_json::from_slice(bytes).map_err(|error| Problem {
        slug: "malformed-json",
        detail: error.to_string(),
        ..Problem::of_status(StatusCode::BAD_REQUEST)
    })?;
    let faults = faults(&value, T::MEMBERS);
    if !faults.is_empty() {
        return Err(Problem::invalid(faults));
    }
    // From the text: a member that is there twice is a fault, too.
    serde_json::from_slice(bytes).map_err(|error| Problem::invalid(vec![of_the_whole(error)]))
}

fn faults(value: &Value, members: &[Member]) -> Vec<Fault> {
    let Value::Object(object) = value else { return vec![of_the_whole("must be an object")] };
    let names: Vec<&str> = members.iter().map(|(name, ..)| *name).collect();
    let unknown = object.keys().filter(|key| !names.contains(&key.as_str()));
    let mut faults: Vec<Fault> = unknown
        .map(|key| key.chars().take(60).collect::<String>().replace('~', "~0").replace('/', "~1"))
        .map(|key| fault(&key, format!("is not known here; {} are", names.join(", "))))
        .take(MOST_FAULTS)
        .collect();
    for (name, required, reads) in members {
        match object.get(*name) {
            None if *required => faults.push(fault(name, "is required")),
            None => {}
            Some(value) => faults.extend(reads(value).err().map(|error| fault(name, error))),
        }
    }
    faults
}

fn fault(member: &str, detail: impl ToString) -> Fault {
    Fault { pointer: format!("/{member}"), detail: detail.to_string() }
}

fn of_the_whole(detail: impl ToString) -> Fault {
    Fault { pointer: String::new(), detail: detail.to_string() }
}
