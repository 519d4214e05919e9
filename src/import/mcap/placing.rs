//! Where the scanner was at a time: transforms or a pose topic, interpolated, brought into the plane.
//!
//! The scanner's pose is the product of all steps from the root, each interpolated by itself; of a pose topic, the
//! robot's pose times the way from the robot to the scanner. A topic's covariance is the robot's; carried to the scanner,
//! which sits at the lever `l` from the robot (in the map's frame), it is `J C J^T` with
//!
//! ```text
//! J = [1 0 -l.y]
//!     [0 1  l.x]
//!     [0 0    1]
//! ```
//!
//! A scanner mounted head down sees its bearings run clockwise; that is told, not lost.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3};

use super::choice::{Chosen, Poses};
use super::contents::{Kind, is_static, sighting};
use super::error::RecordingError;
use super::frames::{Edge, Frames, Step};
use super::messages::{Transforms, decode};
use super::records::Message;
use super::track::{Sample, Track};
use crate::geometry::{Cov3, Pose, psd_square_root};

/// A scanner may look so far out of the plane, radians: 0.4 % of a range.
const LEVEL: f64 = 0.087;
/// A heading with a larger variance than an even spread over the whole turn has (pi^2 / 3) is not known at all.
const UNKNOWN_HEADING: f64 = 3.3;
/// Variances of a position beyond this say nothing, m^2.
const UNKNOWN_POSITION: f64 = 1e4;

/// Where the scanner was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    pub pose: Pose,
    pub covariance: Option<Cov3>,
    /// It hangs head down: bearings run clockwise.
    pub head_down: bool,
    /// How far out of the plane it looks, radians.
    pub tilt: f64,
}

/// Everything that says where the scanner was.
#[derive(Debug, Default)]
pub struct Placing {
    edges: BTreeMap<Edge, Track>,
    fixed: BTreeMap<Edge, Isometry3<f64>>,
    robot: Option<(String, Kind, Track)>,
    kept: usize,
    pub unreadable: usize,
}

impl Placing {
    /// For what was chosen; nothing else is kept.
    pub fn of(chosen: &Chosen, frames: &Frames) -> Self {
        let mut placing = Self::default();
        for step in chosen.ways.iter().flat_map(|(_, way)| way) {
            if !frames.is_fixed(&step.edge) {
                placing.edges.insert(step.edge.clone(), Track::default());
            } else {
                placing.fixed.insert(step.edge.clone(), Isometry3::identity());
            }
        }
        if let Poses::Topic(name, kind) = &chosen.poses {
            placing.robot = Some((name.clone(), *kind, Track::default()));
        }
        placing
    }

    /// Keeps what a message says, of what is needed; `limit` is how many poses may be kept.
    pub fn note(&mut self, message: &Message<'_>, limit: usize) -> Result<(), RecordingError> {
        let channel = message.channel;
        if channel.encoding != "cdr" {
            return Ok(());
        }
        if let Some((name, kind, track)) = &mut self.robot
            && *name == channel.topic
        {
            match sighting(*kind, message.data) {
                Ok(seen) => {
                    let (logged, stamp) = (message.logged, seen.header.stamp);
                    let sample = seen.pose.map(|pose| Sample { logged, stamp, pose, covariance: seen.covariance });
                    sample.into_iter().for_each(|sample| track.push(sample));
                    self.kept += 1;
                }
                Err(_) => self.unreadable += 1,
            }
        } else if Kind::of(channel) == Kind::Transforms {
            match decode::<Transforms<'_>>(message.data) {
                Ok(transforms) => self.transforms(message, &transforms),
                Err(_) => self.unreadable += 1,
            }
        }
        if self.kept > limit { Err(RecordingError::TooMany { what: "poses and transforms", limit }) } else { Ok(()) }
    }

    fn transforms(&mut self, message: &Message<'_>, transforms: &Transforms<'_>) {
        for transform in &transforms.0 {
            let Some(pose) = transform.pose else { continue };
            let edge = Edge { child: transform.child.to_owned(), parent: transform.header.frame.to_owned() };
            if let Some(fixed) = self.fixed.get_mut(&edge) {
                *fixed = pose;
            } else if !is_static(&message.channel.topic)
                && let Some(track) = self.edges.get_mut(&edge)
            {
                track.push(Sample { logged: message.logged, stamp: transform.header.stamp, pose, covariance: None });
                self.kept += 1;
            }
        }
    }

    /// Once all messages are noted.
    pub fn settle(&mut self) {
        self.edges.values_mut().chain(self.robot.as_mut().map(|(_, _, track)| track)).for_each(Track::settle);
    }

    /// From when to when there are poses: where all that move have some.
    pub fn span(&self) -> Option<(i64, i64)> {
        let tracks = self.edges.values().chain(self.robot.as_ref().map(|(_, _, track)| track));
        tracks.map(Track::span).reduce(|a, b| a.zip(b).map(|(a, b)| (a.0.max(b.0), a.1.min(b.1)))).flatten()
    }

    /// Where a scanner at the end of a way was.
    pub fn at(&self, way: &[Step], epoch: usize, stamp: i64) -> Option<Placed> {
        let (robot, covariance) = match &self.robot {
            Some((_, _, track)) => track.at(epoch, stamp)?,
            None => (Isometry3::identity(), None),
        };
        let mut at = robot;
        for step in way {
            let pose = match self.fixed.get(&step.edge) {
                Some(fixed) => *fixed,
                None => self.edges.get(&step.edge)?.at(epoch, stamp)?.0,
            };
            at *= if step.backwards { pose.inverse() } else { pose };
        }
        let lever = at.translation.vector - robot.translation.vector;
        let turned = at.rotation.to_rotation_matrix();
        let upright = turned[(2, 2)];
        let pose = Pose::new(at.translation.x, at.translation.y, turned[(1, 0)].atan2(turned[(0, 0)]));
        let carried = covariance.and_then(|covariance| carried(&covariance, lever.x, lever.y));
        Some(Placed { pose, covariance: carried, head_down: upright < 0.0, tilt: upright.abs().min(1.0).acos() })
    }
}

impl Placed {
    pub fn is_level(&self) -> bool {
        self.tilt <= LEVEL
    }
}

/// A covariance carried along a lever; `None` where it says nothing.
fn carried(covariance: &Cov3, x: f64, y: f64) -> Option<Cov3> {
    let variances = covariance.diagonal();
    if variances.z > UNKNOWN_HEADING || variances.x.max(variances.y) > UNKNOWN_POSITION {
        return None;
    }
    let j = Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, 0.0, 0.0, 1.0);
    let c = j * covariance * j.transpose();
    let c = (c + c.transpose()) * 0.5;
    psd_square_root(&c).map(|_| c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heading_that_is_uncertain_moves_a_scanner_sideways_by_its_lever() {
        let c = carried(&Cov3::from_diagonal(&[1e-4, 1e-4, 1e-2].into()), 0.5, 0.0).unwrap();
        assert!((c[(1, 1)] - (1e-4 + 0.25e-2)).abs() < 1e-15 && (c[(1, 2)] - 0.5e-2).abs() < 1e-15);
        assert_eq!((c[(0, 0)], carried(&Cov3::from_diagonal(&[1.0, 1.0, 1e3].into()), 0.0, 0.0)), (1e-4, None));
    }
}
