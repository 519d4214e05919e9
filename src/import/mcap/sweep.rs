//! A scan's message into scans with a pose: what moved while the beams went round.
//!
//! Beam `k` is taken `k time_increment` after the message's stamp. While the scanner turns at a constant rate, its
//! bearings, seen from one heading, still lie at equal steps, only other ones: `angle_increment` plus the turn from beam to
//! beam. So a turn costs nothing: the scan has the pose of its middle and an increment that holds the turn.
//!
//! A way does not go into equal bearings. Where the scanner travels more than [`STRETCH`] within a scan, the scan becomes as
//! many shorter ones as it takes, each with the pose of its own middle; no beam is then further than half of that from where
//! it was taken, which adds less than a tenth to the variance of a range with the usual 2 cm. Each of them has the scan's
//! covariance. Their errors count as independent, which they are not; but the parts of a scan look different ways, so
//! that hardly a surface is seen by two of them. Scans that hardly move stay whole, and one that spans more than a turn,
//! which a job may not, is cut in two.

use super::messages::{Scan, few_decimals};
use super::placing::Placed;
use crate::geometry::{Pose, wrap_angle};
use crate::import::heading;
use crate::scan::LaserScan;

/// How far a scanner may travel within a scan, metres.
const STRETCH: f64 = 0.02;
/// Parts of a scan at most.
const MOST_PARTS: usize = 16;
/// A scan that says it takes longer is mistaken about its unit, seconds.
const LONGEST: f64 = 2.0;
/// As a job has it: beams span at most one turn.
const TURN: f64 = std::f64::consts::TAU * (1.0 + 1e-7);
/// Ranges beyond this are none, metres.
const FARTHEST: f64 = 1e6;

/// Whether a message is a scan at all: what a job would be refused for.
pub fn fault(scan: &Scan<'_>, most_beams: usize) -> Option<String> {
    let beams = scan.ranges.len();
    let angles = [scan.angle_min, scan.angle_increment];
    match beams {
        0 => Some("it has no beams".into()),
        _ if beams > most_beams => Some(format!("it has {beams} beams; the limit is {most_beams}")),
        _ if angles.iter().any(|angle| !angle.is_finite() || angle.abs() > 1e3) => {
            Some("its angles are no numbers".into())
        }
        2.. if scan.angle_increment == 0.0 => Some("its angle_increment is zero".into()),
        _ if (beams - 1) as f64 * scan.angle_increment.abs() > 2.0 * TURN => {
            Some("its beams span several turns".into())
        }
        _ => None,
    }
}

/// How long a scan's beams take, seconds: zero where it does not say, or says what cannot be.
pub fn duration(scan: &Scan<'_>) -> f64 {
    let duration = scan.time_increment * scan.ranges.len().saturating_sub(1) as f64;
    if duration.is_finite() && duration.abs() <= LONGEST { duration } else { 0.0 }
}

/// The scans that a message becomes; `None` where the pose of any of its beams is not known. `at` places a time in
/// seconds after the message's stamp.
pub fn scans(scan: &Scan<'_>, at: &dyn Fn(f64) -> Option<Placed>) -> Option<Vec<LaserScan>> {
    let beams = scan.ranges.len();
    let duration = duration(scan);
    let (first, last) = (at(0.0)?, at(duration)?);
    let way = (last.pose.position() - first.pose.position()).norm();
    let turn = wrap_angle(last.pose.theta - first.pose.theta);
    let sense = if first.head_down { -1.0 } else { 1.0 };
    let span = (sense * scan.angle_increment * (beams - 1) as f64 + turn).abs();
    let parts = ((way / STRETCH).ceil() as usize).clamp(1, MOST_PARTS).max(1 + usize::from(span > TURN));
    let bounds = |k: usize| k * beams / parts;
    let parts = (0..parts.min(beams)).map(|k| (bounds(k), bounds(k + 1))).filter(|(a, b)| a < b);
    parts.map(|(begin, end)| part(scan, (begin, end), duration, at)).collect()
}

/// The beams from `begin` up to `end`, from the pose of their middle.
fn part(
    scan: &Scan<'_>,
    (begin, end): (usize, usize),
    duration: f64,
    at: &dyn Fn(f64) -> Option<Placed>,
) -> Option<LaserScan> {
    let steps = (end - 1 - begin) as f64;
    let beam_time = duration / (scan.ranges.len() - 1).max(1) as f64;
    let time = |beam: f64| beam * beam_time;
    let placed = at(time(begin as f64 + steps / 2.0))?;
    let sense = if placed.head_down { -1.0 } else { 1.0 };
    let mut angle_min = sense * (scan.angle_min + begin as f64 * scan.angle_increment);
    let mut angle_increment = sense * scan.angle_increment;
    if duration != 0.0 && steps > 0.0 {
        let (first, last) = (at(time(begin as f64))?, at(time((end - 1) as f64))?);
        angle_min += wrap_angle(first.pose.theta - placed.pose.theta);
        angle_increment += wrap_angle(last.pose.theta - first.pose.theta) / steps;
    }
    let ranges = &scan.ranges[begin..end];
    let (range_min, range_max) = reach(scan);
    let Pose { x, y, theta } = placed.pose;
    Some(LaserScan {
        pose: Pose::new(unrounded(x), unrounded(y), heading(theta)),
        pose_covariance: placed.covariance,
        angle_min,
        angle_increment,
        range_min,
        range_max,
        sigma_range: None,
        frame: 0,
        ranges: ranges.iter().map(|range| returned(*range, range_max)).collect(),
    })
}

/// A coordinate without what products of rotations left of rounding: that of at most nine decimals, where it lies within
/// some last places. A fit decides some things sharply, and should not decide them by that.
fn unrounded(value: f64) -> f64 {
    let few = (value * 1e9).round() / 1e9;
    if (few - value).abs() <= 16.0 * f64::EPSILON * value.abs().max(1.0) { few } else { value }
}

/// The ranges between which a return counts, of drivers that leave them out, too.
fn reach(scan: &Scan<'_>) -> (f64, f64) {
    let range_min = if scan.range_min.is_finite() { scan.range_min.clamp(0.0, FARTHEST / 2.0) } else { 0.0 };
    match scan.range_max {
        given if given.is_finite() && given > range_min => (range_min, given.min(FARTHEST)),
        _ => (range_min, FARTHEST),
    }
}

/// A range, or NaN for none: nothing within range is infinite.
fn returned(range: f32, range_max: f64) -> f64 {
    let range = few_decimals(range);
    if range.is_finite() && range <= range_max { range } else { f64::NAN }
}

/// Some drivers write the largest range there is where nothing came back; a measurement hardly ever is just that. Where it
/// comes this often in a recording, it means no return.
const REPEATED: usize = 20;

/// Takes such ranges out; says whether there were any.
pub fn drop_largest(scans: &mut [LaserScan]) -> bool {
    let largest = |scan: &LaserScan| scan.ranges.iter().filter(|range| **range == scan.range_max).count();
    if scans.iter().map(largest).sum::<usize>() < REPEATED {
        return false;
    }
    for scan in scans {
        let most = scan.range_max;
        scan.ranges.iter_mut().filter(|range| **range == most).for_each(|range| *range = f64::NAN);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec2;
    use crate::import::mcap::messages::Header;

    const BEAMS: usize = 61;
    const SECONDS: f64 = 0.1;
    const WALL: f64 = 3.0;

    /// A scanner that travels and turns, and sees the wall x = 3 m with every beam.
    fn swept(speed: f64, rate: f64, head_down: bool) -> (Scan<'static>, impl Fn(f64) -> Option<Placed>) {
        let at = move |t: f64| {
            let pose = Pose::new(speed * t, 0.2 * speed * t, 0.1 + rate * t);
            Some(Placed { pose, covariance: None, head_down, tilt: 0.0 })
        };
        let sense = if head_down { -1.0 } else { 1.0 };
        let (angle_min, angle_increment) = (-0.6, 0.02);
        let ranges = (0..BEAMS).map(|k| {
            let pose = at(k as f64 * SECONDS / (BEAMS - 1) as f64).unwrap().pose;
            let bearing = sense * (angle_min + k as f64 * angle_increment);
            ((WALL - pose.x) / (pose.theta + bearing).cos()) as f32
        });
        let header = Header { stamp: 0, frame: "laser" };
        let time_increment = SECONDS / (BEAMS - 1) as f64;
        let ranges = ranges.collect();
        (Scan { header, angle_min, angle_increment, time_increment, range_min: 0.1, range_max: 30.0, ranges }, at)
    }

    fn off_the_wall(scans: &[LaserScan]) -> f64 {
        let points = scans
            .iter()
            .flat_map(|scan| (0..scan.ranges.len()).map(|k| scan.pose.project(scan.ranges[k], scan.bearing(k))));
        points.map(|p: Vec2| (p.x - WALL).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_turn_goes_into_the_increment_and_the_scan_stays_whole() {
        for head_down in [false, true] {
            let (scan, at) = swept(0.0, 1.5, head_down);
            let corrected = scans(&scan, &at).unwrap();
            assert_eq!(corrected.len(), 1);
            assert!(off_the_wall(&corrected) < 1e-4, "{}", off_the_wall(&corrected));
            let frozen = scans(&Scan { time_increment: 0.0, ..scan }, &at).unwrap();
            assert!(off_the_wall(&frozen) > 0.05, "or there would be nothing to correct");
        }
    }

    #[test]
    fn a_way_cuts_the_scan_into_parts_that_hardly_move() {
        let (scan, at) = swept(1.0, -0.8, false);
        let corrected = scans(&scan, &at).unwrap();
        assert_eq!(corrected.iter().map(|scan| scan.ranges.len()).sum::<usize>(), BEAMS);
        assert!(corrected.len() == 6 && off_the_wall(&corrected) < STRETCH / 2.0 * 1.2);
        let (slow, at) = swept(0.1, 0.0, false);
        assert_eq!(scans(&slow, &at).unwrap().len(), 1);
    }

    #[test]
    fn a_still_scanner_leaves_the_message_as_it_is_and_more_than_a_turn_is_cut_in_two() {
        let (scan, at) = swept(0.0, 0.0, false);
        let still = &scans(&scan, &at).unwrap()[0];
        assert_eq!((still.angle_min, still.angle_increment), (scan.angle_min, scan.angle_increment));
        let round = Scan { angle_increment: 6.5 / (BEAMS - 1) as f64, ..scan };
        assert_eq!(scans(&round, &at).unwrap().len(), 2);
        assert!(scans(&round, &|_| None).is_none());
    }

    #[test]
    fn what_is_no_return_becomes_none() {
        let [none, nan, most, some] = [f32::INFINITY, f32::NAN, 30.0, 29.99].map(|range| returned(range, 30.0));
        assert!(none.is_nan() && nan.is_nan() && most == 30.0 && some == 29.99);
        let (scan, at) = swept(0.0, 0.0, false);
        let mut often = scans(&Scan { ranges: vec![30.0; REPEATED], ..scan.clone() }, &at).unwrap();
        let mut once = scans(&Scan { ranges: vec![30.0, 2.0], ..scan }, &at).unwrap();
        assert!(drop_largest(&mut often) && often[0].ranges.iter().all(|range| range.is_nan()));
        assert!(!drop_largest(&mut once) && once[0].ranges == [30.0, 2.0]);
    }
}
