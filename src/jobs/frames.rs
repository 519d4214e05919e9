//! The frames of a join: guessed in its request, told by its map.

use crate::geometry::{Cov3, Pose, in_frame};
use crate::living::Guess;
use crate::map::{FittedMap, Frame};

/// No motion at all.
pub const ORIGIN: Pose = Pose { x: 0.0, y: 0.0, theta: 0.0 };

/// The frames of a join.
#[derive(Debug, Clone, PartialEq)]
pub struct Joined {
    /// One a frame; the first holds.
    pub guesses: Vec<Guess>,
    pub named: Vec<Named>,
}

/// Where a map's frame is: at `offset` in one of the frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    pub map_id: String,
    pub frame: usize,
    pub offset: Pose,
}

impl Joined {
    /// Says of a map where its frames were put: a frame each, and the first, which is held.
    pub fn tell(&self, map: &mut FittedMap, places: &[Pose]) {
        let still = |index: usize| Frame { index, motion: ORIGIN, covariance: Cov3::zeros(), put: places[index] };
        let mut frames: Vec<Frame> = (0..places.len()).map(still).collect();
        for moved in std::mem::take(&mut map.frames) {
            if let Some(frame) = frames.get_mut(moved.index) {
                *frame = Frame { put: frame.put, ..moved };
            }
        }
        map.frames = frames;
    }

    /// Where every map's frame lies in the joined one, with covariance, in the request's order.
    pub fn frames<'a>(&'a self, map: &FittedMap) -> Vec<(&'a str, Pose, Cov3)> {
        let told = |named: &'a Named| {
            let frame = map.frames.get(named.frame)?;
            let at = frame.pose();
            let pose = in_frame(&at, &named.offset);
            let arm = pose.position() - at.position();
            let jacobian = Cov3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x, 0.0, 0.0, 1.0);
            let covariance = jacobian * frame.pose_covariance() * jacobian.transpose();
            Some((named.map_id.as_str(), pose, (covariance + covariance.transpose()) * 0.5))
        };
        self.named.iter().filter_map(told).collect()
    }
}
