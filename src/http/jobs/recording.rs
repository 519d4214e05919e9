//! A job from a recording: `multipart/form-data` with the file and a job's body without scans becomes the JSON that goes
//! every job's way.
//!
//! What is wrong with the options is told before the recording is read, with pointers into them; what is wrong with the
//! recording points to `/recording`, or to the option that has to change.

use axum::http::StatusCode;
use bytes::Bytes;
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::document::Document;
use crate::http::shared::compute::Leash;
use crate::http::shared::multipart::{Part, parts};
use crate::http::shared::problem::Problem;
use crate::import::{Ask, LogError, RecordingError, RecordingLimits, Selection, job_json, read_log};
use crate::jobs::document::Node;
use crate::jobs::{Fault, JobRequest, Limits, RequestError};

/// What options have beside a job's members.
const OWN: [&str; 5] = ["scan_topic", "pose_topic", "every", "from", "to"];
/// Values that options may have: a recording has the scans, so they are small.
const MOST_OPTIONS: usize = 10_000;
/// Chunks together may unpack to so many times what a body may have.
const UNPACKED: u64 = 16;
/// Transforms and poses of a recording.
const MOST_POSES: usize = 1_000_000;

/// The job of a form. `largest` is how many bytes a body may have, and so the job that is made of it.
pub fn document(
    body: Bytes,
    boundary: &str,
    limits: &Limits,
    largest: usize,
    leash: &Leash,
) -> Result<Document, Problem> {
    let (recording, options) = both(parts(&body, boundary)?)?;
    drop(body);
    let digest = hex::encode(Sha256::new().chain_update(Sha256::digest(&options)).chain_update(&recording).finalize());
    let Options { ask, selection, job } = Options::read(&options, limits)?;
    let may = RecordingLimits {
        file: largest as u64,
        record: largest as u64 / 2,
        unpacked: UNPACKED * largest as u64,
        scans: limits.scans,
        ranges: limits.values,
        poses: MOST_POSES,
    };
    let source = || Ok(Box::new(std::io::Cursor::new(recording.clone())) as Box<dyn std::io::Read>);
    let log = read_log(&source, &ask, &selection, &may, &|| leash.holds()).map_err(refused)?;
    let json = job_json(&job, &log.scans, largest).ok_or_else(|| {
        let detail = format!(
            "the recording's {} scans make a job of more than {largest} bytes; take every so many of them with every, or a \
             part with from and to",
            log.scans.len()
        );
        Problem { detail, ..Problem::of_status(StatusCode::PAYLOAD_TOO_LARGE) }
    })?;
    let message = (!log.notes.is_empty()).then(|| log.notes.join("; "));
    Ok(Document { json: json.into(), digest, message })
}

/// The two parts of a form.
fn both(parts: Vec<Part>) -> Result<(Bytes, Bytes), Problem> {
    let mut faults = Vec::new();
    let mut fault = |pointer: String, detail: &str| faults.push(Fault { pointer, detail: detail.into() });
    for part in parts.iter().filter(|part| !["recording", "options"].contains(&part.name.as_str())) {
        fault(pointer_to(&part.name), "is not known here; recording and options are");
    }
    let mut one = |name: &str, what: &str| {
        let mut named = parts.iter().filter(|part| part.name == name);
        let found = named.next().map(|part| part.content.clone());
        if found.is_none() {
            fault(format!("/{name}"), &format!("is required: {what}"));
        } else if named.next().is_some() {
            fault(format!("/{name}"), "is there twice");
        }
        found
    };
    let recording = one("recording", "an MCAP recording or a CARMEN log");
    let options = one("options", "a job's body without scans, as JSON");
    match (recording, options) {
        (Some(recording), Some(options)) if faults.is_empty() => Ok((recording, options)),
        _ => Err(Problem::invalid(faults)),
    }
}

/// The pointer to a member that a client named.
fn pointer_to(name: &str) -> String {
    let shown: String = name.chars().take(60).collect();
    format!("/{}", shown.replace('~', "~0").replace('/', "~1"))
}

/// What is asked of a recording.
pub(super) struct Options {
    ask: Ask,
    selection: Selection,
    /// The job, without scans.
    job: Map<String, Value>,
}

impl Options {
    /// Every fault that can be told without the recording.
    pub(super) fn read(json: &[u8], limits: &Limits) -> Result<Self, Problem> {
        Node::parse(json, MOST_OPTIONS)?;
        let value = serde_json::from_slice(json).map_err(|error| Problem {
            slug: "malformed-json",
            detail: error.to_string(),
            ..Problem::of_status(StatusCode::BAD_REQUEST)
        })?;
        let Value::Object(mut job) = value else {
            let detail = "options are an object: a job's body without scans".into();
            return Err(Problem::invalid(vec![Fault { pointer: String::new(), detail }]));
        };
        let mut faults = Vec::new();
        let mut taken = |name: &str| job.remove(name).filter(|value| !value.is_null());
        let mut fault = |name: &str, detail: &str| {
            faults.push(Fault { pointer: format!("/{name}"), detail: detail.to_owned() });
        };
        let mut text = |name: &str, value: Option<Value>| match value {
            Some(Value::String(text)) if text.len() <= 256 => Some(text),
            Some(_) => {
                fault(name, "must be a string of at most 256 bytes");
                None
            }
            None => None,
        };
        let ask = Ask {
            scan_topic: text("scan_topic", taken("scan_topic")),
            pose_topic: text("pose_topic", taken("pose_topic")),
        };
        let mut count = |name: &str, least: u64, value: Option<Value>| {
            let given = value.as_ref().map(Value::as_u64);
            match given {
                Some(Some(count)) if count >= least => usize::try_from(count).ok(),
                Some(_) => {
                    fault(name, &format!("must be an integer of at least {least}"));
                    None
                }
                None => None,
            }
        };
        let selection = Selection {
            every: count("every", 1, taken("every")).unwrap_or(1),
            from: count("from", 0, taken("from")).unwrap_or(0),
            to: count("to", 1, taken("to")),
        };
        if taken("scans").is_some() {
            fault("scans", "are the recording's; leave them out");
        }
        let known = || JobRequest::MEMBERS.into_iter().filter(|name| *name != "scans");
        let strangers: Vec<String> = job.keys().filter(|name| known().all(|own| own != *name)).cloned().collect();
        for name in strangers {
            job.remove(&name);
            let detail = format!("is not known here; {} are", known().chain(OWN).collect::<Vec<_>>().join(", "));
            faults.push(Fault { pointer: pointer_to(&name), detail });
        }
        // What a job without scans is told beside that.
        let without = serde_json::to_vec(&job).map_err(|error| Problem::internal(&error))?;
        match JobRequest::parse(&without, limits) {
            Err(RequestError::Faults(found)) => faults.extend(found.into_iter().filter(|f| f.pointer != "/scans")),
            Err(other) => return Err(other.into()),
            Ok(_) => {}
        }
        if faults.is_empty() { Ok(Self { ask, selection, job }) } else { Err(Problem::invalid(faults)) }
    }
}

/// What is wrong with the recording, as a problem.
fn refused(error: LogError) -> Problem {
    let too_large = match &error {
        LogError::Recording(RecordingError::Stopped) => return Problem::too_slow(),
        LogError::Recording(RecordingError::TooLarge { .. }) => true,
        LogError::Recording(RecordingError::Io(io)) | LogError::Io(io) => io.kind() == std::io::ErrorKind::FileTooLarge,
        _ => false,
    };
    let detail = error.to_string();
    if too_large {
        return Problem { detail, ..Problem::of_status(StatusCode::PAYLOAD_TOO_LARGE) };
    }
    let pointer = format!("/{}", error.option().unwrap_or("recording"));
    Problem::invalid(vec![Fault { pointer, detail }])
}
