//! A JSON document, compact enough to be read from a hostile client.
//!
//! Validation wants to see the whole document, to list every fault and not only the first; a generic JSON tree would
//! cost 32 bytes a number. Here an array of numbers and nulls is one `Vec<f64>` (null is NaN), and the number of values
//! is capped while parsing, before memory is spent on them. Nesting is limited by serde_json itself (128). A number
//! that f64 cannot carry (1e400) is a syntax error there.

use std::cell::Cell;
use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use thiserror::Error;

/// Why a document was not read.
#[derive(Debug, Error)]
pub enum DocumentError {
    /// Not JSON, or a number f64 cannot carry, or nested too deeply.
    #[error("{0}")]
    Syntax(#[from] serde_json::Error),
    #[error("the document has more than {limit} values, or too many that are not numbers")]
    TooLarge { limit: usize },
}

/// A value that is no number costs as much as this many that are.
const COST_OF_A_NODE: usize = 8;
/// What a member of an object costs besides its value, with a short name.
const COST_OF_A_MEMBER: usize = 6;
/// What a number or a null costs more where it is not among its like alone.
const COST_AMONG_OTHERS: usize = 3;

/// A JSON value.
#[derive(Debug, Clone, PartialEq)]
pub enum Node {
    Null,
    Bool(bool),
    Number(f64),
    Text(String),
    /// An array of nothing but numbers and nulls, the empty one too; null is NaN.
    Numbers(Vec<f64>),
    Array(Vec<Node>),
    Object(Vec<(String, Node)>),
}

impl Node {
    /// Parses a document of at most `limit` values.
    pub fn parse(json: &[u8], limit: usize) -> Result<Self, DocumentError> {
        let budget = Cell::new(Some(limit));
        let mut deserializer = serde_json::Deserializer::from_slice(json);
        let node = Seed { budget: &budget }.deserialize(&mut deserializer);
        if budget.get().is_none() {
            return Err(DocumentError::TooLarge { limit });
        }
        let node = node?;
        deserializer.end()?;
        Ok(node)
    }

    /// A member of an object; the last of equal names counts.
    pub fn member(&self, name: &str) -> Option<&Node> {
        match self {
            Node::Object(members) => members.iter().rev().find(|(key, _)| key == name).map(|(_, value)| value),
            _ => None,
        }
    }

    /// What kind of value this is, for a message.
    pub fn kind(&self) -> &'static str {
        match self {
            Node::Null => "null",
            Node::Bool(_) => "a boolean",
            Node::Number(_) => "a number",
            Node::Text(_) => "a string",
            Node::Numbers(_) | Node::Array(_) => "an array",
            Node::Object(_) => "an object",
        }
    }
}

struct Seed<'a> {
    /// Values that may still come; `None` once there were too many.
    budget: &'a Cell<Option<usize>>,
}

impl<'de> DeserializeSeed<'de> for Seed<'_> {
    type Value = Node;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Node, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'a> Seed<'a> {
    fn spend<E: serde::de::Error>(&self, cost: usize) -> Result<(), E> {
        let left = self.budget.get().and_then(|left| left.checked_sub(cost));
        self.budget.set(left);
        if left.is_some() { Ok(()) } else { Err(E::custom("too many values")) }
    }

    fn again(&self) -> Seed<'a> {
        Seed { budget: self.budget }
    }
}

impl<'de> Visitor<'de> for Seed<'_> {
    type Value = Node;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E: serde::de::Error>(self) -> Result<Node, E> {
        self.spend(1).map(|()| Node::Null)
    }

    fn visit_bool<E: serde::de::Error>(self, value: bool) -> Result<Node, E> {
        self.spend(COST_OF_A_NODE).map(|()| Node::Bool(value))
    }

    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<Node, E> {
        self.spend(1).map(|()| Node::Number(value))
    }

    fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<Node, E> {
        self.visit_f64(value as f64)
    }

    fn visit_u64<E: serde::de::Error>(self, value: u64) -> Result<Node, E> {
        self.visit_f64(value as f64)
    }

    fn visit_str<E: serde::de::Error>(self, value: &str) -> Result<Node, E> {
        self.spend(COST_OF_A_NODE).map(|()| Node::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Node, A::Error> {
        self.spend(COST_OF_A_NODE)?;
        let mut numbers = Vec::new();
        while let Some(node) = seq.next_element_seed(self.again())? {
            match node {
                Node::Number(value) => numbers.push(value),
                Node::Null => numbers.push(f64::NAN),
                other => {
                    self.spend(COST_AMONG_OTHERS.saturating_mul(numbers.len()))?;
                    let number = |v: f64| if v.is_nan() { Node::Null } else { Node::Number(v) };
                    let mut nodes: Vec<Node> = numbers.into_iter().map(number).collect();
                    nodes.push(other);
                    while let Some(node) = seq.next_element_seed(self.again())? {
                        if matches!(node, Node::Number(_) | Node::Null) {
                            self.spend(COST_AMONG_OTHERS)?;
                        }
                        nodes.push(node);
                    }
                    return Ok(Node::Array(nodes));
                }
            }
        }
        Ok(Node::Numbers(numbers))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Node, A::Error> {
        self.spend(COST_OF_A_NODE)?;
        let mut members = Vec::new();
        while let Some(key) = map.next_key::<String>()? {
            self.spend(COST_OF_A_MEMBER + key.len() / size_of::<f64>())?;
            members.push((key, map.next_value_seed(self.again())?));
        }
        Ok(Node::Object(members))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_numbers_are_compact_and_others_are_not() {
        let node = Node::parse(br#"{"r": [1, null, 2.5], "m": [1, "x", null], "e": []}"#, 1000).unwrap();
        let Some(Node::Numbers(r)) = node.member("r") else { panic!("{node:?}") };
        assert!(r[0] == 1.0 && r[1].is_nan() && r[2] == 2.5);
        let mixed = Node::Array(vec![Node::Number(1.0), Node::Text("x".into()), Node::Null]);
        assert_eq!(node.member("m"), Some(&mixed));
        assert_eq!(node.member("e"), Some(&Node::Numbers(vec![])));
    }

    #[test]
    fn what_json_cannot_carry_is_a_syntax_error() {
        for bad in ["1e400", "NaN", "[1,]", "{\"a\":1", "", "01", "[1] x"] {
            assert!(Node::parse(bad.as_bytes(), 100).is_err(), "{bad}");
        }
        assert!(Node::parse("[".repeat(200).as_bytes(), 1000).is_err());
        assert!(matches!(Node::parse(b"[1,2,3,4]", 11), Err(DocumentError::TooLarge { .. })));
        assert!(Node::parse(b"[1,2,3,4]", 12).is_ok());
        let members = (0..100).map(|k| format!("\"{k}\":null")).collect::<Vec<_>>().join(",");
        assert!(Node::parse(format!("{{{members}}}").as_bytes(), 700).is_err(), "members are not free");
    }
}
