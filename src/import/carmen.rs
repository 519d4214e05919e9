//! CARMEN logs: `FLASER n r1..rn x y theta x y theta t host t`, metres and radians.
//!
//! The first pose is the laser's, corrected. Beam `i` points at -90 degrees plus `i` steps; a scanner with 180 or 181
//! beams has steps of 1 degree, one with 360 or 361 half a degree. Other lines (ODOM, PARAM, ROBOTLASER1, comments) are
//! passed over. What a scanner writes for "no return" differs from log to log (81.83, 50.0, 32.76 have been seen, and
//! in one log 81.87, 81.89 and 81.91): the largest values, where they are repeated as no measurement is, mean no
//! return, never a surface.

use super::{ImportError, heading};
use crate::geometry::Pose;
use crate::scan::LaserScan;

/// A range below this is the scanner seeing itself.
const RANGE_MIN: f64 = 0.05;
/// The largest values mean "no return" where they come this often, and more often than the next ten values together.
const REPEATED: usize = 20;
/// How far apart the largest values may lie, metres.
const SPREAD: f64 = 0.1;

/// The scans of a log, in the file's order.
pub fn parse_carmen(text: &str) -> Result<Vec<LaserScan>, ImportError> {
    let mut scans = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        if words.next() == Some("FLASER") {
            scans.push(parse_flaser(words).map_err(|detail| ImportError::Line { line: k + 1, detail })?);
        }
    }
    if scans.is_empty() {
        return Err(ImportError::NoScans);
    }
    if let Some(none) = no_return_value(&scans) {
        for scan in &mut scans {
            scan.ranges.iter_mut().filter(|range| **range >= none).for_each(|range| *range = f64::NAN);
        }
    }
    let farthest = scans.iter().flat_map(|scan| &scan.ranges).copied().fold(RANGE_MIN * 2.0, f64::max);
    scans.iter_mut().for_each(|scan| scan.range_max = farthest);
    Ok(scans)
}

fn parse_flaser<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<LaserScan, String> {
    let beams: usize = words.next().and_then(|n| n.parse().ok()).ok_or("FLASER needs a number of beams")?;
    let step = match beams {
        180 | 181 => 1.0f64,
        360 | 361 => 0.5,
        _ => return Err(format!("{beams} beams; 180, 181, 360 and 361 are known")),
    };
    let mut number = |what: &str| -> Result<f64, String> {
        let word = words.next().ok_or_else(|| format!("the line ends before its {what}"))?;
        let value: f64 = word.parse().map_err(|_| format!("{what} {word} is not a number"))?;
        if value.is_finite() { Ok(value) } else { Err(format!("{what} {word} is not finite")) }
    };
    let ranges = (0..beams).map(|_| number("range")).collect::<Result<Vec<_>, _>>()?;
    let pose = Pose::new(number("x")?, number("y")?, heading(number("theta")?));
    Ok(LaserScan {
        pose,
        pose_covariance: None,
        sigma_range: None,
        frame: 0,
        angle_min: -std::f64::consts::FRAC_PI_2,
        angle_increment: step.to_radians(),
        range_min: RANGE_MIN,
        range_max: f64::INFINITY,
        ranges,
    })
}

/// The value from which ranges stand for "no return", where the log has one.
fn no_return_value(scans: &[LaserScan]) -> Option<f64> {
    // Floats from +0 up sort like their bits; sorted, they are counted without a table of them.
    let mut sorted: Vec<u64> =
        scans.iter().flat_map(|scan| &scan.ranges).map(|range| (range.max(0.0) + 0.0).to_bits()).collect();
    sorted.sort_unstable();
    let largest = f64::from_bits(*sorted.last()?);
    let begin = sorted.partition_point(|bits| f64::from_bits(*bits) < largest - SPREAD);
    let (below, top) = sorted.split_at(begin);
    // The ten largest values below, however often each comes.
    let values = below.chunk_by(|a, b| a == b).rev();
    let next: usize = values.take(10).map(<[u64]>::len).sum();
    let lowest = f64::from_bits(*top.first()?);
    (top.len() >= REPEATED && top.len() > next).then_some(lowest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(range: impl Fn(usize) -> f64) -> String {
        let ranges: Vec<String> = (0..180).map(|k| format!("{:.2}", range(k))).collect();
        format!("FLASER 180 {} 1.5 -2.0 7.0 1.4 -2.0 7.0 12.5 host 12.6", ranges.join(" "))
    }

    #[test]
    fn scans_are_read_and_other_lines_passed_over() {
        let log = format!("# a comment\nPARAM x 1\nODOM 1 2 3\n{}\n", line(|k| 1.0 + 0.01 * k as f64));
        let scans = parse_carmen(&log).unwrap();
        assert_eq!(scans.len(), 1);
        assert_eq!(scans[0].pose, Pose::new(1.5, -2.0, 0.716814692820));
        assert!((scans[0].bearing(90)).abs() < 1e-12 && scans[0].range(179).is_some());
    }

    #[test]
    fn the_value_that_repeats_at_the_top_is_no_return() {
        let scans = parse_carmen(&line(|k| {
            if k % 3 == 0 {
                81.83
            } else if k % 10 == 1 {
                81.87
            } else {
                2.0 + 0.01 * k as f64
            }
        }))
        .unwrap();
        assert_eq!((scans[0].range(0), scans[0].range(1)), (None, None));
        assert!(scans[0].range(2).is_some() && scans[0].range_max < 10.0);
    }

    #[test]
    fn a_torn_line_says_where_and_what() {
        let torn = line(|_| 1.0).split_at(300).0.to_owned();
        let error = parse_carmen(&format!("ODOM\n{torn}")).unwrap_err();
        assert!(error.to_string().starts_with("line 2: the line ends before its range"), "{error}");
        assert_eq!(parse_carmen("ODOM 1 2 3\n"), Err(ImportError::NoScans));
    }
}
