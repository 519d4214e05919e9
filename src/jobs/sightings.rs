//! Where were these scans taken? The question, read and validated: scans as a job's, each with a prior or none, and the
//! motions between them.

use super::document::Node;
use super::limits::Limits;
use super::reader::Reader;
use super::request::RequestError;
use crate::geometry::{Cov3, Pose};
use crate::localize::{Motion, Prior, Sighted};
use crate::scan::LaserScan;
use crate::uncertainty::Kind;

/// Scans that are located in one question: each by itself, or as one trajectory, whose poses are unknowns together.
const MOST_SCANS: usize = 1000;
const MOST_ALONG: usize = 200;
/// What is located in milliseconds: so many returns, each scan by itself and with a prior.
const FEW_RETURNS: usize = 20_000;
/// Hypotheses that may be asked for.
const MOST_HYPOTHESES: i64 = 50;

/// A validated question.
#[derive(Debug, Clone)]
pub struct Sightings {
    pub scans: Vec<Sighted>,
    /// One fewer than scans, where these are one trajectory.
    pub motions: Option<Vec<Motion>>,
    pub kind: Kind,
    pub hypotheses: usize,
}

impl Sightings {
    /// Parses and validates a question, listing every fault.
    pub fn parse(json: &[u8], limits: &Limits) -> Result<Self, RequestError> {
        let document = Node::parse(json, limits.values)?;
        let mut reader = Reader::new(limits);
        let read = reader.sightings(&document);
        reader.concluded(read)
    }

    /// Ranges of all scans.
    pub fn ranges(&self) -> usize {
        self.scans.iter().map(|own| own.scan.ranges.len()).sum()
    }

    /// Whether it is answered in milliseconds.
    pub fn is_light(&self) -> bool {
        self.motions.is_none() && self.ranges() <= FEW_RETURNS && self.scans.iter().all(|own| own.prior.is_some())
    }
}

impl Reader<'_> {
    fn sightings(&mut self, document: &Node) -> Option<Sightings> {
        self.object(document, "", &["scans", "noise", "kind", "motions", "hypotheses"])?;
        let kind = self.optional(document, "", "kind", |r, n, p| r.choice(n, p, &["propagated", "posterior"]));
        let hypotheses = self.optional(document, "", "hypotheses", |r, n, p| r.integer(n, p, 0, MOST_HYPOTHESES));
        let noise = self.required(document, "", "noise", Self::noise);
        let motions = self.optional(document, "", "motions", Self::motions);
        let along = matches!(&motions, Some(Some(_)));
        let scans = self.required(document, "", "scans", |r, n, p| r.placed(n, p, along));
        if let (Some(Some(motions)), Some(scans)) = (&motions, &scans)
            && motions.len() + 1 != scans.len()
        {
            let detail = format!("{} motions for {} scans; there must be one fewer", motions.len(), scans.len());
            self.fault::<()>("/motions", detail);
        }
        let (noise, scans) = (noise?, scans?);
        let sighted = |(scan, placed): (LaserScan, bool)| Sighted {
            prior: placed.then(|| Prior::new(scan.pose, scan.pose_covariance(&noise))),
            sigma_range: noise.sigma_range,
            scan,
        };
        Some(Sightings {
            scans: scans.into_iter().map(sighted).collect(),
            motions: motions?,
            kind: if kind? == Some("posterior") { Kind::Posterior } else { Kind::Propagated },
            hypotheses: hypotheses?.unwrap_or(1) as usize,
        })
    }

    /// Scans, and whether each says where it was taken.
    fn placed(&mut self, node: &Node, at: &str, along: bool) -> Option<Vec<(LaserScan, bool)>> {
        let most = if along { MOST_ALONG } else { MOST_SCANS };
        let Node::Array(scans) = node else {
            return self.fault(at, "must be an array of scans, at least one");
        };
        if scans.len() > most {
            return self.fault(at, format!("{} scans; the limit is {most}", scans.len()));
        }
        let read = scans.iter().enumerate().map(|(k, scan)| {
            let placed = !matches!(scan.member("pose"), Some(Node::Null));
            let at = format!("{at}/{k}");
            let pose = |r: &mut Self, n: &Node, p: &str| match n {
                Node::Null => Some(Pose::new(0.0, 0.0, 0.0)),
                own => r.pose(own, p),
            };
            Some((self.scan_from(scan, &at, pose)?, placed))
        });
        read.collect::<Vec<_>>().into_iter().collect()
    }

    fn motions(&mut self, node: &Node, at: &str) -> Option<Vec<Motion>> {
        match node {
            Node::Numbers(none) if none.is_empty() => Some(Vec::new()),
            Node::Array(motions) if motions.len() >= MOST_ALONG => {
                self.fault(at, format!("{} motions; the limit is {}", motions.len(), MOST_ALONG - 1))
            }
            Node::Array(motions) => {
                let read = motions.iter().enumerate().map(|(k, motion)| self.motion(motion, &format!("{at}/{k}")));
                read.collect::<Vec<_>>().into_iter().collect()
            }
            other => self.fault(at, format!("must be an array of motions, not {}", other.kind())),
        }
    }

    fn motion(&mut self, node: &Node, at: &str) -> Option<Motion> {
        self.object(node, at, &["x", "y", "theta", "covariance"])?;
        let mut number = |name| self.required(node, at, name, |r, n, p| r.number(n, p, -1e6, 1e6));
        let (x, y, theta) = (number("x"), number("y"), number("theta"));
        let covariance = self.required(node, at, "covariance", |r, n, p| {
            let own: Cov3 = r.covariance(n, p)?;
            match own.cholesky() {
                Some(_) => Some(own),
                None => r.fault(p, "must be positive definite"),
            }
        });
        Some(Motion { by: Pose::new(x?, y?, theta?), covariance: covariance? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn scan(pose: Value) -> Value {
        json!({"pose": pose, "angle_min": 0, "angle_increment": 0.1, "range_min": 0.1, "range_max": 9, "ranges": [1, 2]})
    }

    fn question(more: Value) -> Value {
        let noise = json!({"sigma_x": 0.1, "sigma_y": 0.2, "sigma_theta": 0.3, "sigma_range": 0.02});
        let mut own = json!({"scans": [scan(json!({"x": 1, "y": 2, "theta": 3})), scan(Value::Null)], "noise": noise});
        own.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        own
    }

    fn faults(question: &Value) -> Vec<String> {
        match Sightings::parse(question.to_string().as_bytes(), &Limits::default()) {
            Err(RequestError::Faults(faults)) => faults.into_iter().map(|fault| fault.pointer).collect(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_pose_is_a_prior_and_null_is_anywhere() {
        let read = Sightings::parse(question(json!({})).to_string().as_bytes(), &Limits::default()).unwrap();
        let prior = read.scans[0].prior.unwrap();
        assert_eq!((prior.pose, prior.covariance[(1, 1)]), (Pose::new(1.0, 2.0, 3.0), 0.2 * 0.2));
        assert!(read.scans[1].prior.is_none() && read.motions.is_none() && read.hypotheses == 1);
    }

    #[test]
    fn every_fault_has_its_pointer() {
        let motion = json!({"x": 0, "y": 0, "theta": 0, "covariance": [1, 0, 0, 0, 1, 0, 0, 0, 0]});
        let wrong = question(json!({"motions": [motion], "kind": "other", "hypotheses": 1.5, "more": 1}));
        assert_eq!(faults(&wrong), ["/more", "/kind", "/hypotheses", "/motions/0/covariance"]);
        assert_eq!(faults(&question(json!({"motions": []}))), ["/motions"]);
        assert_eq!(faults(&question(json!({"scans": []}))), ["/scans"]);
        let mut missing = question(json!({}));
        missing["scans"][0].as_object_mut().unwrap().remove("pose");
        assert_eq!(faults(&missing), ["/scans/0/pose"]);
    }
}
