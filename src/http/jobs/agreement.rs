//! The document and the parsers of bodies know the same members and choices: each schema makes a body with a stranger
//! everywhere, and the parser has to name exactly what the schema has.

use serde_json::{Map, Value, json};

use super::recording::Options;
use crate::http::document;
use crate::http::shared::problem::Problem;
use crate::jobs::{JobRequest, Limits, RequestError, Sightings, join_body};

/// A name that no schema has, and a text that is among no choices.
const STRANGER: &str = "a stranger";

/// What a parser says of a document: pointers, and what is wrong there.
type Faults = Vec<(String, String)>;

struct Schemas(Value);

impl Schemas {
    fn of_the_document() -> Self {
        let document: Value = serde_json::from_str(&document()).unwrap();
        Self(document["components"]["schemas"].clone())
    }

    /// A schema behind its references, and behind the choice of null.
    fn resolved<'a>(&'a self, schema: &'a Value) -> &'a Value {
        if let Some(name) = schema["$ref"].as_str().and_then(|name| name.strip_prefix("#/components/schemas/")) {
            return self.resolved(&self.0[name]);
        }
        let choices = schema["oneOf"].as_array();
        match choices.and_then(|all| all.iter().find(|one| one["type"] != "null")) {
            Some(own) => self.resolved(own),
            None => schema,
        }
    }

    /// A document with every member that a schema knows and one that it does not, and with no valid choice anywhere;
    /// and what a parser that agrees says of it, by pointer.
    fn provocation(&self, schema: &Value, at: &str, expected: &mut Vec<(String, Vec<String>)>) -> Value {
        let schema = self.resolved(schema);
        if let Some(choices) = schema["enum"].as_array() {
            let choices = choices.iter().map(|choice| choice.as_str().unwrap().to_owned());
            expected.push((at.to_owned(), choices.collect()));
            return json!(STRANGER);
        }
        if let Some(properties) = schema["properties"].as_object() {
            expected.push((format!("{at}/{STRANGER}"), properties.keys().cloned().collect()));
            let known = properties
                .iter()
                .map(|(name, own)| (name.clone(), self.provocation(own, &format!("{at}/{name}"), expected)));
            let members: Map<String, Value> = known.chain([(STRANGER.to_owned(), json!(1))]).collect();
            return members.into();
        }
        let kind = schema["type"].as_array().and_then(|kinds| kinds.iter().find(|kind| *kind != "null"));
        match kind.unwrap_or(&schema["type"]).as_str() {
            Some("array") => {
                let count = schema["minItems"].as_u64().unwrap_or(2).max(1);
                (0..count).map(|k| self.provocation(&schema["items"], &format!("{at}/{k}"), expected)).collect()
            }
            Some("string") => json!("text"),
            Some("object") => json!({"a": "b"}),
            _ => json!(1),
        }
    }

    /// Holds a schema against a parser, both ways.
    fn agrees(&self, name: &str, parse: impl Fn(&[u8]) -> Faults) {
        let mut expected = Vec::new();
        let provocation = self.provocation(&self.0[name], "", &mut expected);
        assert!(!expected.is_empty(), "{name} is not in the document");
        let faults = parse(provocation.to_string().as_bytes());
        let expects = |pointer: &str| expected.iter().any(|(own, _)| own == pointer);
        let unknown = |(pointer, detail): &&(String, String)| {
            !expects(pointer) && (detail.contains("is not known here") || detail.contains("must be one of"))
        };
        for (pointer, names) in &expected {
            let said = faults.iter().find(|(own, _)| own == pointer);
            let (_, detail) = said.unwrap_or_else(|| panic!("{name}: nothing is said of {pointer} in {faults:?}"));
            let told = listed(detail);
            let mut names = names.clone();
            names.sort();
            assert_eq!(told, names, "{name}: the parser and the document differ at {pointer}: {detail}");
        }
        let strangers: Vec<_> = faults.iter().filter(unknown).collect();
        assert!(strangers.is_empty(), "{name}: the parser does not know what the document has: {strangers:?}");
    }
}

/// The names in "is not known here; a, b are" and in "must be one of a, b".
fn listed(detail: &str) -> Vec<String> {
    let list = detail.strip_prefix("is not known here; ").and_then(|rest| rest.strip_suffix(" are"));
    let list = list.or_else(|| detail.strip_prefix("must be one of ")).unwrap_or_else(|| panic!("{detail}"));
    let mut names: Vec<String> = list.split(", ").map(str::to_owned).collect();
    names.sort();
    names
}

fn of_request<T>(read: Result<T, RequestError>) -> Faults {
    match read {
        Err(RequestError::Faults(faults)) => faults.into_iter().map(|fault| (fault.pointer, fault.detail)).collect(),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("it has a stranger in it"),
    }
}

fn of_problem<T>(read: Result<T, Problem>) -> Faults {
    let errors = read.err().expect("it has a stranger in it").errors;
    errors.into_iter().map(|fault| (fault.pointer.unwrap_or_default(), fault.detail)).collect()
}

fn job() -> JobRequest {
    let pose = json!({"x": 1.0, "y": 1.0, "theta": 0.0});
    let scan = json!({"pose": pose, "angle_min": 0.0, "angle_increment": 0.1, "range_min": 0.1, "range_max": 9.0,
        "ranges": [1.0]});
    let job = json!({"scans": [scan], "map": {"distance": "sdf", "resolution": 0.5},
        "noise": {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_theta": 0.01, "sigma_range": 0.01}});
    JobRequest::parse(job.to_string().as_bytes(), &Limits::default()).unwrap()
}

#[test]
fn the_document_and_the_parsers_know_the_same_members_and_choices() {
    let (schemas, limits, job) = (Schemas::of_the_document(), Limits::default(), job());
    schemas.agrees("JobRequest", |json| of_request(JobRequest::parse(json, &limits)));
    schemas.agrees("UpdateRequest", |json| of_request(job.updated(json, &limits)));
    schemas.agrees("JoinRequest", |json| of_request(join_body(json, &limits)));
    schemas.agrees("LocalizeBody", |json| of_request(Sightings::parse(json, &limits)));
    schemas.agrees("RecordingOptions", |json| of_problem(Options::read(json, &limits)));
}
