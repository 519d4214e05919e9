//! What is asked: points, which covariance, which arrays.

use super::FIELDS;
use crate::geometry::Vec2;
use crate::http::shared::problem::Problem;
use crate::jobs::Fault;
use crate::jobs::document::Node;
use crate::uncertainty::Kind;

/// Points in one query at most.
const MOST_POINTS: usize = 250_000;
/// What parsing a point may cost: its array, and its two numbers.
const COST_OF_A_POINT: usize = 12;
const MOST_FAULTS: usize = 100;
/// numpy writes 118 bytes for an array of two dimensions: a dict, and a tuple in it.
const LONGEST_HEADER: usize = 1024;
const DEEPEST_HEADER: i32 = 2;

/// A question about points.
pub struct Question {
    pub points: Vec<Vec2>,
    pub kind: Kind,
    /// A mark for each of `FIELDS`.
    pub fields: [bool; FIELDS.len()],
}

/// Marks for the named fields, or the name that is none.
pub fn marks(names: &[&str]) -> Result<[bool; FIELDS.len()], String> {
    let mut marks = [false; FIELDS.len()];
    for name in names {
        let at = FIELDS.iter().position(|field| field == name).ok_or_else(|| (*name).to_owned())?;
        marks[at] = true;
    }
    Ok(marks)
}

/// Points from a float64 array of shape (n, 2).
pub fn points_of_npy(bytes: &[u8]) -> Result<Vec<Vec2>, Problem> {
    let bad = |detail: String| Problem::invalid(vec![Fault { pointer: String::new(), detail }]);
    if !is_plain_header(bytes) {
        return Err(bad("is not an npy file of a plain array".into()));
    }
    let file = npyz::NpyFile::new(bytes).map_err(|error| bad(format!("is not an npy file: {error}")))?;
    let [count, 2] = file.shape()[..] else { return Err(bad("must have the shape (n, 2)".into())) };
    if count > MOST_POINTS as u64 {
        return Err(bad(format!("{count} points; the limit is {MOST_POINTS}")));
    }
    let by_columns = file.order() == npyz::Order::Fortran;
    let flat: Vec<f64> = file.into_vec().map_err(|error| bad(format!("must be float64: {error}")))?;
    if let Some(at) = flat.iter().position(|v| !v.is_finite()) {
        return Err(bad(format!("number {at} is not finite")));
    }
    let n = count as usize;
    let point = |k: usize| match by_columns {
        true => Vec2::new(flat[k], flat[n + k]),
        false => Vec2::new(flat[2 * k], flat[2 * k + 1]),
    };
    Ok((0..n).map(point).collect())
}

/// Whether an npy file's header is that of a plain array: `npyz` reads a header as a Python literal, in time that doubles
/// with every bracket that is nested, and numbers of any length.
fn is_plain_header(bytes: &[u8]) -> bool {
    let length = |at: usize, size: usize| {
        bytes.get(at..at + size).map(|own| own.iter().rev().fold(0, |sum, byte| (sum << 8) | usize::from(*byte)))
    };
    let (start, length) = match bytes.get(..8) {
        Some([0x93, b'N', b'U', b'M', b'P', b'Y', 1, _]) => (10, length(8, 2)),
        Some([0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _]) => (12, length(8, 4)),
        _ => return false,
    };
    let Some(header) = length.filter(|length| *length <= LONGEST_HEADER).and_then(|n| bytes.get(start..start + n))
    else {
        return false;
    };
    let mut depth = 0i32;
    header.iter().all(|byte| {
        depth += i32::from(b"([{".contains(byte)) - i32::from(b")]}".contains(byte));
        (0..=DEEPEST_HEADER).contains(&depth)
    })
}

pub fn parse(json: &[u8]) -> Result<Question, Problem> {
    let document = Node::parse(json, COST_OF_A_POINT * (MOST_POINTS + 1)).map_err(Problem::from)?;
    let mut faults = Vec::new();
    let mut fault = |pointer: String, detail: String| {
        if faults.len() < MOST_FAULTS {
            faults.push(Fault { pointer, detail });
        }
    };
    let kind = match document.member("kind") {
        None | Some(Node::Null) => Kind::Propagated,
        Some(Node::Text(name)) if name == "propagated" => Kind::Propagated,
        Some(Node::Text(name)) if name == "posterior" => Kind::Posterior,
        Some(_) => {
            fault("/kind".into(), "must be one of propagated, posterior".into());
            Kind::Propagated
        }
    };
    let fields = match document.member("fields") {
        None | Some(Node::Null) => Ok([true; FIELDS.len()]),
        Some(Node::Numbers(none)) if none.is_empty() => marks(&[]),
        Some(Node::Array(names)) => {
            let text = |node: &Node| if let Node::Text(name) = node { name.clone() } else { node.kind().to_owned() };
            let names: Vec<String> = names.iter().map(text).collect();
            marks(&names.iter().map(String::as_str).collect::<Vec<_>>())
        }
        Some(other) => Err(other.kind().to_owned()),
    };
    if let Err(unknown) = &fields {
        fault("/fields".into(), format!("{unknown} is not one of {}", FIELDS.join(", ")));
    }
    if let Node::Object(members) = &document {
        for (name, _) in members.iter().filter(|(name, _)| !["points", "kind", "fields"].contains(&name.as_str())) {
            fault(format!("/{}", name.replace('~', "~0").replace('/', "~1")), "is not known here".into());
        }
    }
    let mut points = Vec::new();
    match (&document, document.member("points")) {
        (Node::Object(_), Some(Node::Numbers(none))) if none.is_empty() => {}
        (Node::Object(_), Some(Node::Array(rows))) if rows.len() > MOST_POINTS => {
            fault("/points".into(), format!("{} points; the limit is {MOST_POINTS}", rows.len()));
        }
        (Node::Object(_), Some(Node::Array(rows))) => {
            for (k, row) in rows.iter().enumerate() {
                match row {
                    Node::Numbers(p) if p.len() == 2 && p.iter().all(|v| v.is_finite()) => {
                        points.push(Vec2::new(p[0], p[1]));
                    }
                    _ => fault(format!("/points/{k}"), "a point is [x, y]".into()),
                }
            }
        }
        (Node::Object(_), None) => fault("/points".into(), "is required".into()),
        (Node::Object(_), Some(_)) => fault("/points".into(), "must be an array of [x, y]".into()),
        (other, _) => fault(String::new(), format!("a query is an object, not {}", other.kind())),
    }
    match (faults.is_empty(), fields) {
        (true, Ok(fields)) => Ok(Question { points, kind, fields }),
        _ => Err(Problem::invalid(faults)),
    }
}
