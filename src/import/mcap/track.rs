//! Poses over time: of a frame in its parent, or of what a topic tells of.
//!
//! Between two samples the position moves straight and the rotation at a constant rate, as tf2 has it; outside of them
//! nothing is known. Two samples far apart in time *and* place say little about the way between: no pose comes of them.
//!
//! Time may go back within a recording: a simulation is started anew, or another recording was played in a loop. Then what
//! follows is another *epoch*: its samples are never mixed with those before. Streams are compared by their own count of
//! such jumps, so that a scan of epoch k is placed by samples of epoch k. What comes a little late (several nodes
//! publish on one topic) is put in order.

use nalgebra::Isometry3;

use crate::geometry::Cov3;

/// A stamp that lies so far before an earlier one begins an epoch, nanoseconds.
const BACK: i64 = 1_000_000_000;
/// Samples further apart than this, nanoseconds, metres and radians, are not interpolated.
const LONGEST_GAP: i64 = 1_000_000_000;
const FARTHEST_WAY: f64 = 0.5;
const LARGEST_TURN: f64 = 0.5;

/// A pose at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When it was recorded, and when it held, nanoseconds.
    pub logged: u64,
    pub stamp: i64,
    pub pose: Isometry3<f64>,
    pub covariance: Option<Cov3>,
}

/// Poses over time.
#[derive(Debug, Clone, Default)]
pub struct Track {
    samples: Vec<Sample>,
    /// Where each epoch's samples begin.
    epochs: Vec<usize>,
}

impl Track {
    pub fn push(&mut self, sample: Sample) {
        self.samples.push(sample);
    }

    /// Puts the samples in order, once all are there.
    pub fn settle(&mut self) {
        self.samples.sort_by_key(|sample| sample.logged);
        let epochs = epochs(self.samples.iter().map(|sample| sample.stamp));
        self.epochs = (0..=epochs.last().copied().unwrap_or(0)).map(|k| epochs.partition_point(|e| *e < k)).collect();
        let ends: Vec<usize> = self.epochs.iter().skip(1).copied().chain([self.samples.len()]).collect();
        for (begin, end) in self.epochs.iter().zip(ends) {
            self.samples[*begin..end].sort_by_key(|sample| sample.stamp);
        }
    }

    /// From the first stamp to the last, of all epochs.
    pub fn span(&self) -> Option<(i64, i64)> {
        let stamps = || self.samples.iter().map(|sample| sample.stamp);
        Some((stamps().min()?, stamps().max()?))
    }

    /// The pose at a time, with its covariance where both samples around it have one.
    pub fn at(&self, epoch: usize, stamp: i64) -> Option<(Isometry3<f64>, Option<Cov3>)> {
        let begin = *self.epochs.get(epoch)?;
        let end = self.epochs.get(epoch + 1).copied().unwrap_or(self.samples.len());
        let samples = &self.samples[begin..end];
        let after = samples.partition_point(|sample| sample.stamp < stamp);
        let b = samples.get(after)?;
        if b.stamp == stamp {
            return Some((b.pose, b.covariance));
        }
        let a = samples.get(after.checked_sub(1)?)?;
        let way = (b.pose.translation.vector - a.pose.translation.vector).norm();
        let turn = a.pose.rotation.angle_to(&b.pose.rotation);
        if b.stamp.saturating_sub(a.stamp) > LONGEST_GAP && (way > FARTHEST_WAY || turn > LARGEST_TURN) {
            return None;
        }
        let share = (stamp - a.stamp) as f64 / (b.stamp - a.stamp) as f64;
        let translation = a.pose.translation.vector.lerp(&b.pose.translation.vector, share);
        // Half a turn from one sample to the next has no direction.
        let rotation = a.pose.rotation.try_slerp(&b.pose.rotation, share, 1e-9)?;
        let covariance = a.covariance.zip(b.covariance).map(|(a, b)| a * (1.0 - share) + b * share);
        Some((Isometry3::from_parts(translation.into(), rotation), covariance))
    }
}

/// The epoch of each stamp, of stamps in the order they were recorded.
pub fn epochs(stamps: impl IntoIterator<Item = i64>) -> Vec<usize> {
    let (mut epoch, mut latest) = (0, i64::MIN);
    let of = stamps.into_iter().map(|stamp| {
        if stamp < latest.saturating_sub(BACK) {
            (epoch, latest) = (epoch + 1, stamp);
        }
        latest = latest.max(stamp);
        epoch
    });
    of.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    const SECOND: i64 = 1_000_000_000;

    fn track(samples: &[(f64, f64, f64)]) -> Track {
        let mut track = Track::default();
        for (k, (seconds, x, yaw)) in samples.iter().enumerate() {
            let rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, *yaw);
            let pose = Isometry3::from_parts(Translation3::new(*x, 0.0, 0.0), rotation);
            let stamp = (seconds * SECOND as f64) as i64;
            track.push(Sample { logged: k as u64, stamp, pose, covariance: None });
        }
        track.settle();
        track
    }

    #[test]
    fn between_samples_a_pose_is_interpolated_and_outside_there_is_none() {
        let track = track(&[(0.0, 0.0, 0.0), (1.0, 0.4, 0.2), (0.5, 0.1, 0.1)]);
        let (pose, _) = track.at(0, SECOND * 3 / 4).unwrap();
        assert!((pose.translation.x - 0.25).abs() < 1e-12 && (pose.rotation.euler_angles().2 - 0.15).abs() < 1e-12);
        assert_eq!((track.at(0, -1), track.at(0, SECOND + 1), track.at(1, 0)), (None, None, None));
    }

    #[test]
    fn a_long_gap_is_bridged_only_where_nothing_moved() {
        let track = track(&[(0.0, 0.0, 0.0), (9.0, 0.1, 0.0), (18.0, 5.0, 0.0), (18.5, 6.0, 0.0)]);
        assert!(track.at(0, 4 * SECOND).is_some() && track.at(0, 12 * SECOND).is_none());
        assert!(track.at(0, 18 * SECOND + SECOND / 4).is_some());
    }

    #[test]
    fn where_time_goes_back_another_epoch_begins() {
        assert_eq!(epochs([0, 10 * SECOND, 9 * SECOND + 5, 2 * SECOND, 3 * SECOND]), [0, 0, 0, 1, 1]);
        let track = track(&[(0.0, 0.0, 0.0), (3.0, 0.3, 0.0), (0.0, 1.0, 0.0), (3.0, 1.3, 0.0)]);
        let x = |epoch| track.at(epoch, SECOND).unwrap().0.translation.x;
        assert!((x(0) - 0.1).abs() < 1e-12 && (x(1) - 1.1).abs() < 1e-12);
    }
}
