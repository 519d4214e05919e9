//! Names and labels: of a request, and changed afterwards.

use std::collections::BTreeMap;

use super::document::Node;
use super::limits::Limits;
use super::reader::{LONGEST_TEXT, Reader};
use super::request::{JobRequest, RequestError};

/// A name or none, and labels, each where it is mentioned.
pub type LabelChange = (Option<Option<String>>, Option<BTreeMap<String, String>>);

const MOST_LABELS: usize = 64;
/// Seconds: a job that ends in less was never begun, and one of more than a month has no deadline.
const DEADLINES: (f64, f64) = (0.001, 2_678_400.0);

impl JobRequest {
    /// Reads a change of name and labels: the name, where it is mentioned at all, and the labels, likewise.
    pub fn parse_labels(json: &[u8]) -> Result<LabelChange, RequestError> {
        let limits = Limits::default();
        let document = Node::parse(json, limits.values)?;
        let mut reader = Reader::new(&limits);
        if !matches!(document, Node::Object(_)) {
            let _: Option<()> = reader.fault("", format!("a change is an object, not {}", document.kind()));
            return Err(RequestError::Faults(reader.faults));
        }
        reader.known(&document, "", &["name", "labels"]);
        let name = reader.optional(&document, "", "name", Reader::text);
        let labels = reader.optional(&document, "", "labels", Reader::labels);
        match (name, labels, reader.faults.is_empty()) {
            (Some(name), Some(labels), true) => {
                let labels = document.member("labels").map(|_| labels.unwrap_or_default());
                Ok((document.member("name").map(|_| name), labels))
            }
            _ => Err(RequestError::Faults(reader.faults)),
        }
    }
}

/// What a job says of itself, member by member: name, labels, priority, and its deadline in seconds.
pub(super) type About =
    (Option<Option<String>>, Option<Option<BTreeMap<String, String>>>, Option<Option<i64>>, Option<Option<f64>>);

impl Reader<'_> {
    pub(super) fn about(&mut self, document: &Node) -> About {
        let deadline =
            self.optional(document, "", "deadline_seconds", |r, n, p| r.positive(n, p, DEADLINES.0, DEADLINES.1));
        let name = self.optional(document, "", "name", Self::text);
        let labels = self.optional(document, "", "labels", Self::labels);
        let priority = self.optional(document, "", "priority", |r, n, p| r.integer(n, p, -1000, 1000));
        (name, labels, priority, deadline)
    }

    pub(super) fn labels(&mut self, node: &Node, at: &str) -> Option<BTreeMap<String, String>> {
        let Node::Object(members) = node else {
            return self.fault(at, format!("must be an object of strings, not {}", node.kind()));
        };
        if members.len() > MOST_LABELS {
            return self.fault(at, format!("{} labels; the limit is {MOST_LABELS}", members.len()));
        }
        let mut labels = BTreeMap::new();
        for (key, value) in members {
            let pointer = format!("{at}/{}", key.replace('~', "~0").replace('/', "~1"));
            if key.is_empty() || key.len() > LONGEST_TEXT || key.contains([':', '\0']) {
                self.fault::<()>(&pointer, "a label's key has 1 to 256 bytes, no colon and no U+0000");
            }
            if let Some(value) = self.text(value, &pointer) {
                labels.insert(key.clone(), value);
            }
        }
        Some(labels)
    }
}
