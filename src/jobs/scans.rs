//! Reading scans, their poses and their noise: of a job, an update, and of scans that are to be located.

use std::f64::consts::TAU;

use super::document::Node;
use super::reader::{FARTHEST, Reader};
use crate::geometry::{Cov3, Pose, psd_square_root};
use crate::scan::{LaserScan, Noise};

/// Standard deviations outside this cannot be squared into anything useful.
const SIGMAS: (f64, f64) = (1e-6, 1e3);

impl Reader<'_> {
    pub(super) fn scans(&mut self, node: &Node, at: &str) -> Option<Vec<LaserScan>> {
        match node {
            Node::Array(scans) if scans.len() > self.limits.scans => {
                self.fault(at, format!("{} scans; the limit is {}", scans.len(), self.limits.scans))
            }
            Node::Array(scans) => {
                let read: Vec<Option<LaserScan>> =
                    scans.iter().enumerate().map(|(k, scan)| self.scan(scan, &format!("{at}/{k}"))).collect();
                read.into_iter().collect()
            }
            Node::Numbers(none) if none.is_empty() => self.fault(at, "at least one scan is needed"),
            Node::Numbers(_) => self.fault(at, "a scan is an object"),
            other => self.fault(at, format!("must be an array of scans, not {}", other.kind())),
        }
    }

    fn scan(&mut self, node: &Node, at: &str) -> Option<LaserScan> {
        self.scan_from(node, at, Self::pose)
    }

    /// A scan whose pose is read like this.
    pub(super) fn scan_from(
        &mut self,
        node: &Node,
        at: &str,
        pose: impl FnOnce(&mut Self, &Node, &str) -> Option<Pose>,
    ) -> Option<LaserScan> {
        if !matches!(node, Node::Object(_)) {
            return self.fault(at, format!("a scan is an object, not {}", node.kind()));
        }
        let names = ["pose", "pose_covariance", "angle_min", "angle_increment", "range_min", "range_max", "ranges"];
        self.known(node, at, &names);
        let pose = self.required(node, at, "pose", pose);
        let pose_covariance = self.optional(node, at, "pose_covariance", Self::covariance);
        let angle_min = self.required(node, at, "angle_min", |r, n, p| r.number(n, p, -1e3, 1e3));
        let angle_increment = self.required(node, at, "angle_increment", |r, n, p| r.number(n, p, -TAU, TAU));
        let range_min = self.required(node, at, "range_min", |r, n, p| r.number(n, p, 0.0, FARTHEST));
        let range_max = self.required(node, at, "range_max", |r, n, p| r.number(n, p, 0.0, FARTHEST));
        let ranges = self.required(node, at, "ranges", Self::ranges);
        if let (Some(low), Some(high)) = (range_min, range_max)
            && low >= high
        {
            self.fault::<()>(&format!("{at}/range_max"), "must be greater than range_min");
        }
        if let (Some(increment), Some(ranges)) = (angle_increment, &ranges)
            && ranges.len() > 1
        {
            if increment == 0.0 {
                self.fault::<()>(&format!("{at}/angle_increment"), "must not be zero");
            } else if (ranges.len() - 1) as f64 * increment.abs() > TAU * (1.0 + 1e-6) {
                let detail = format!("{} beams at this increment span more than one turn", ranges.len());
                self.fault::<()>(&format!("{at}/angle_increment"), detail);
            }
        }
        Some(LaserScan {
            pose: pose?,
            pose_covariance: pose_covariance?,
            sigma_range: None,
            frame: 0,
            angle_min: angle_min?,
            angle_increment: angle_increment?,
            range_min: range_min?,
            range_max: range_max?,
            ranges: ranges?,
        })
    }

    fn ranges(&mut self, node: &Node, at: &str) -> Option<Vec<f64>> {
        match node {
            Node::Numbers(ranges) if ranges.is_empty() => self.fault(at, "a scan has at least one beam"),
            Node::Numbers(ranges) if ranges.len() > self.limits.beams_a_scan => {
                self.fault(at, format!("{} beams; the limit is {}", ranges.len(), self.limits.beams_a_scan))
            }
            Node::Numbers(ranges) => Some(ranges.clone()),
            Node::Array(entries) if entries.len() > self.limits.beams_a_scan => {
                self.fault(at, format!("{} beams; the limit is {}", entries.len(), self.limits.beams_a_scan))
            }
            Node::Array(entries) => {
                for (k, entry) in entries.iter().enumerate() {
                    if !matches!(entry, Node::Number(_) | Node::Null) {
                        let detail = format!("a range is a number or null, not {}", entry.kind());
                        self.fault::<()>(&format!("{at}/{k}"), detail);
                    }
                }
                None
            }
            other => self.fault(at, format!("must be an array of numbers and nulls, not {}", other.kind())),
        }
    }

    pub(super) fn pose(&mut self, node: &Node, at: &str) -> Option<Pose> {
        self.object(node, at, &["x", "y", "theta"])?;
        let x = self.required(node, at, "x", |r, n, p| r.number(n, p, -FARTHEST, FARTHEST));
        let y = self.required(node, at, "y", |r, n, p| r.number(n, p, -FARTHEST, FARTHEST));
        let theta = self.required(node, at, "theta", |r, n, p| r.number(n, p, -FARTHEST, FARTHEST));
        Some(Pose::new(x?, y?, theta?))
    }

    pub(super) fn covariance(&mut self, node: &Node, at: &str) -> Option<Cov3> {
        let entries = self.numbers(node, at, 9)?;
        let c = Cov3::from_row_slice(&entries);
        let largest = c.amax();
        if largest > SIGMAS.1 * SIGMAS.1 {
            return self.fault(at, format!("variances must not exceed {:e}", SIGMAS.1 * SIGMAS.1));
        }
        if (c - c.transpose()).amax() > 1e-9 * largest {
            return self.fault(at, "must be symmetric");
        }
        if psd_square_root(&c).is_none() {
            return self.fault(at, "must be positive semi-definite");
        }
        Some((c + c.transpose()) * 0.5)
    }

    pub(super) fn noise(&mut self, node: &Node, at: &str) -> Option<Noise> {
        self.object(node, at, &["sigma_x", "sigma_y", "sigma_theta", "sigma_range"])?;
        let mut sigma = |name| self.required(node, at, name, |r, n, p| r.positive(n, p, SIGMAS.0, SIGMAS.1));
        let (x, y, theta, range) = (sigma("sigma_x"), sigma("sigma_y"), sigma("sigma_theta"), sigma("sigma_range"));
        Some(Noise { sigma_x: x?, sigma_y: y?, sigma_theta: theta?, sigma_range: range? })
    }
}
