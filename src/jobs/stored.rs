//! What the store keeps as a job's request.
//!
//! Of a first fit it is the client's body, byte for byte. Of an update it is the map's own stored request and the bodies of
//! the updates since, the last of them this job's: all that the map is formed from, so that nothing is lost where the
//! maps it grew from are deleted.
//!
//! ```text
//! mapfit {"parent": "MAP", "version": 3, "joined": 0, "lengths": [1200, 800, 900]}\n  BODY BODY BODY
//! ```
//!
//! Of a join it is what is kept of the maps, `joined` of them, and then the join's own body in place of the first fit's. No
//! body begins like that: a body is JSON.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::join::join_body;
use super::limits::Limits;
use super::request::{JobRequest, RequestError};

const MARK: &[u8] = b"mapfit ";
/// Bytes of all bodies together: as many as a request of all scans could have, well padded.
const MOST_BYTES: usize = 512 << 20;
/// Joins of joins of joins.
const DEEPEST: usize = 8;

/// Which map a map grew from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lineage {
    /// The map's id; `None` of a first fit.
    pub parent: Option<String>,
    /// 1 for a first fit.
    pub version: i64,
}

impl Lineage {
    pub const FIRST: Self = Self { parent: None, version: 1 };
}

/// A stored request; see the module.
#[derive(Debug, Clone, PartialEq)]
pub struct Stored<'a> {
    pub lineage: Lineage,
    /// What is kept of the maps that are joined, where the first body is a join's.
    members: Vec<Cow<'a, [u8]>>,
    /// The first fit's, then the updates', this job's last.
    bodies: Vec<Cow<'a, [u8]>>,
}

#[derive(Serialize, Deserialize)]
struct Header {
    #[serde(flatten)]
    lineage: Lineage,
    #[serde(default)]
    joined: usize,
    lengths: Vec<usize>,
}

impl<'a> Stored<'a> {
    /// What a store kept.
    pub fn read(bytes: &'a [u8]) -> Result<Self, RequestError> {
        let Some(rest) = bytes.strip_prefix(MARK) else {
            return Ok(Self { lineage: Lineage::FIRST, members: Vec::new(), bodies: vec![bytes.into()] });
        };
        let end = rest.iter().position(|byte| *byte == b'\n').ok_or(RequestError::Damaged("its header has no end"))?;
        let header: Header =
            serde_json::from_slice(&rest[..end]).map_err(|_| RequestError::Damaged("its header is no JSON"))?;
        let mut left = &rest[end + 1..];
        let mut bodies = Vec::with_capacity(header.lengths.len().min(left.len()));
        for length in header.lengths {
            let (body, behind) = left.split_at_checked(length).ok_or(RequestError::Damaged("a body is cut short"))?;
            bodies.push(body.into());
            left = behind;
        }
        if bodies.len() <= header.joined || !left.is_empty() {
            return Err(RequestError::Damaged("its lengths do not fit"));
        }
        let own = bodies.split_off(header.joined);
        Ok(Self { lineage: header.lineage, members: bodies, bodies: own })
    }

    /// The request of an update: this one and one more body. `None` where that is too much to keep.
    pub fn updated(mut self, lineage: Lineage, body: &'a [u8]) -> Option<Self> {
        self.bodies.push(body.into());
        let bytes = self.members.iter().chain(&self.bodies).map(|body| body.len()).sum::<usize>();
        (bytes <= MOST_BYTES).then_some(Self { lineage, ..self })
    }

    /// The request of a join: what is kept of the maps, and the join's body. `None` where that is too much to keep, or
    /// joins of joins are nested too deeply.
    pub fn joined(members: Vec<Vec<u8>>, body: &'a [u8]) -> Option<Self> {
        let members: Vec<Cow<'a, [u8]>> = members.into_iter().map(Cow::Owned).collect();
        let own = Self { lineage: Lineage::FIRST, members, bodies: vec![body.into()] };
        let bytes = own.members.iter().map(|member| member.len()).sum::<usize>() + body.len();
        (bytes <= MOST_BYTES && own.depth(DEEPEST) <= DEEPEST).then_some(own)
    }

    /// How deep joins are nested in it, or one more than `most`.
    fn depth(&self, most: usize) -> usize {
        if self.members.is_empty() {
            return 0;
        }
        if most == 0 {
            return 1;
        }
        let within = |member: &Cow<'_, [u8]>| Stored::read(member).map_or(most, |own| own.depth(most - 1));
        1 + self.members.iter().map(within).max().unwrap_or(0)
    }

    /// The job's own body, as its client sent it.
    pub fn body(&self) -> &[u8] {
        self.bodies.last().map_or(&[], |body| body)
    }

    /// What to keep.
    pub fn to_bytes(&self) -> Result<Vec<u8>, serde_json::Error> {
        if let ([], [body], Lineage { parent: None, version: 1 }) = (&self.members[..], &self.bodies[..], &self.lineage)
        {
            return Ok(body.to_vec());
        }
        let all = || self.members.iter().chain(&self.bodies);
        let lengths = all().map(|body| body.len()).collect();
        let mut bytes = MARK.to_vec();
        serde_json::to_writer(
            &mut bytes,
            &Header { lineage: self.lineage.clone(), joined: self.members.len(), lengths },
        )?;
        bytes.push(b'\n');
        all().for_each(|body| bytes.extend_from_slice(body));
        Ok(bytes)
    }

    /// The request of all scans.
    pub fn request(&self, limits: &Limits) -> Result<JobRequest, RequestError> {
        let (first, updates) = self.bodies.split_first().ok_or(RequestError::Damaged("it has no body"))?;
        let first = match self.members.is_empty() {
            true => JobRequest::parse(first, limits)?,
            false => {
                let members = self.members.iter().map(|member| Stored::read(member)?.request(limits));
                join_body(first, limits)?.request(&members.collect::<Result<Vec<_>, _>>()?, limits)?
            }
        };
        updates.iter().try_fold(first, |before, body| before.updated(body, limits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_read_again_and_a_body_alone_is_kept_as_it_is() {
        let first = Stored::read(b"{\"scans\": []}").unwrap();
        assert_eq!(first.to_bytes().unwrap(), b"{\"scans\": []}");
        let lineage = Lineage { parent: Some("a".into()), version: 2 };
        let second = first.updated(lineage.clone(), b" {} ").unwrap();
        let bytes = second.to_bytes().unwrap();
        let again = Stored::read(&bytes).unwrap();
        assert_eq!((again.body(), &again), (&b" {} "[..], &second));
        let third = again.updated(Lineage { parent: Some("b".into()), version: 3 }, b"[]").unwrap();
        assert_eq!(Stored::read(&third.to_bytes().unwrap()).unwrap(), third);
        for cut in 1..bytes.len() {
            let cut = Stored::read(&bytes[..cut]);
            assert!(cut.is_err() || cut.unwrap().lineage == Lineage::FIRST);
        }
    }
}
