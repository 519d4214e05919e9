//! Reading a request's members, keeping every fault: the primitives of [`super::request`].
//!
//! A reader's method gives `None` where the member is faulty, after noting the fault with its pointer; the caller goes
//! on with the other members and gives up at the end.

use super::document::Node;
use super::limits::{Fault, Limits};

/// Coordinates and ranges beyond this are no building's.
pub(super) const FARTHEST: f64 = 1e6;
/// Texts longer than this are no names.
pub(super) const LONGEST_TEXT: usize = 256;
/// Faults listed at most; the rest are counted.
const MOST_FAULTS: usize = 100;

/// What has been read of a document: its faults.
pub(super) struct Reader<'a> {
    pub limits: &'a Limits,
    pub faults: Vec<Fault>,
    pub unlisted: usize,
}

impl<'a> Reader<'a> {
    pub fn new(limits: &'a Limits) -> Self {
        Self { limits, faults: Vec::new(), unlisted: 0 }
    }

    pub fn fault<T>(&mut self, pointer: &str, detail: impl Into<String>) -> Option<T> {
        if self.faults.len() < MOST_FAULTS {
            self.faults.push(Fault { pointer: pointer.to_owned(), detail: detail.into() });
        } else {
            self.unlisted += 1;
        }
        None
    }

    pub fn required<T>(
        &mut self,
        node: &Node,
        at: &str,
        name: &str,
        read: impl FnOnce(&mut Self, &Node, &str) -> Option<T>,
    ) -> Option<T> {
        let pointer = format!("{at}/{name}");
        match node.member(name) {
            Some(value) => read(self, value, &pointer),
            None => self.fault(&pointer, "is required"),
        }
    }

    /// `Some(None)` where the member is absent or null; `None` where it is faulty.
    pub fn optional<T>(
        &mut self,
        node: &Node,
        at: &str,
        name: &str,
        read: impl FnOnce(&mut Self, &Node, &str) -> Option<T>,
    ) -> Option<Option<T>> {
        match node.member(name) {
            None | Some(Node::Null) => Some(None),
            Some(value) => read(self, value, &format!("{at}/{name}")).map(Some),
        }
    }

    pub fn object(&mut self, node: &Node, at: &str, names: &[&str]) -> Option<()> {
        if !matches!(node, Node::Object(_)) {
            return self.fault(at, format!("must be an object, not {}", node.kind()));
        }
        self.known(node, at, names);
        Some(())
    }

    pub fn known(&mut self, node: &Node, at: &str, names: &[&str]) {
        let Node::Object(members) = node else { return };
        for (key, _) in members {
            if !names.contains(&key.as_str()) {
                let shown: String = key.chars().take(60).collect();
                let pointer = format!("{at}/{}", shown.replace('~', "~0").replace('/', "~1"));
                self.fault::<()>(&pointer, format!("is not known here; {} are", names.join(", ")));
            }
        }
    }

    pub fn number(&mut self, node: &Node, at: &str, low: f64, high: f64) -> Option<f64> {
        match node {
            Node::Number(value) if (low..=high).contains(value) => Some(*value),
            Node::Number(value) => self.fault(at, format!("must lie in [{low}, {high}], not {value}")),
            other => self.fault(at, format!("must be a number, not {}", other.kind())),
        }
    }

    pub fn positive(&mut self, node: &Node, at: &str, low: f64, high: f64) -> Option<f64> {
        match node {
            Node::Number(value) if *value <= 0.0 => self.fault(at, format!("must be positive, not {value}")),
            _ => self.number(node, at, low, high),
        }
    }

    pub fn integer(&mut self, node: &Node, at: &str, low: i64, high: i64) -> Option<i64> {
        let value = self.number(node, at, low as f64, high as f64)?;
        if value.fract() == 0.0 {
            Some(value as i64)
        } else {
            self.fault(at, format!("must be an integer, not {value}"))
        }
    }

    pub fn numbers(&mut self, node: &Node, at: &str, count: usize) -> Option<Vec<f64>> {
        match node {
            Node::Numbers(values) if values.len() != count => {
                self.fault(at, format!("must have {count} numbers, not {}", values.len()))
            }
            Node::Numbers(values) => match values.iter().position(|v| !v.is_finite() || v.abs() > 4.0 * FARTHEST) {
                None => Some(values.clone()),
                Some(k) => self.fault(&format!("{at}/{k}"), format!("must be a number of at most {FARTHEST:e}")),
            },
            Node::Array(_) => self.fault(at, format!("must have {count} numbers and nothing else")),
            other => self.fault(at, format!("must be an array of {count} numbers, not {}", other.kind())),
        }
    }

    pub fn text(&mut self, node: &Node, at: &str) -> Option<String> {
        match node {
            Node::Text(text) if text.chars().count() > LONGEST_TEXT => {
                self.fault(at, format!("has {} characters; the limit is {LONGEST_TEXT}", text.chars().count()))
            }
            Node::Text(text) if text.contains('\0') => self.fault(at, "must not contain U+0000"),
            Node::Text(text) => Some(text.clone()),
            other => self.fault(at, format!("must be a string, not {}", other.kind())),
        }
    }

    pub fn choice<'c>(&mut self, node: &Node, at: &str, choices: &[&'c str]) -> Option<&'c str> {
        let found = match node {
            Node::Text(text) => choices.iter().copied().find(|choice| choice == text),
            _ => None,
        };
        if found.is_some() { found } else { self.fault(at, format!("must be one of {}", choices.join(", "))) }
    }
}
