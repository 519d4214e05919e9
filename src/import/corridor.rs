//! The Willow Garage corridor of the shared data: walls and scans of the method's second experiment.

use serde::Deserialize;
use thiserror::Error;

use crate::geometry::{Pose, Vec2};
use crate::scan::LaserScan;
use crate::sim::{Lidar, Plan, Survey};

#[derive(Debug, Error)]
pub enum CorridorError {
    #[error("line {0} of the walls is not x1,y1,x2,y2")]
    Wall(usize),
    #[error("the scans cannot be read: {0}")]
    Scans(#[from] serde_json::Error),
}

#[derive(Deserialize)]
struct Log {
    angle_min: f64,
    angle_increment: f64,
    range_max: f64,
    scans: Vec<LogScan>,
}

#[derive(Deserialize)]
struct LogScan {
    pose_true: [f64; 3],
    ranges: Vec<Option<f64>>,
}

/// Reads `walls.csv` and the unpacked `scans.json`.
pub fn parse_corridor(walls: &str, scans: &str) -> Result<Survey, CorridorError> {
    let wall = |(number, line): (usize, &str)| {
        let ends: Vec<f64> = line.split(',').filter_map(|text| text.trim().parse().ok()).collect();
        match ends[..] {
            [a, b, c, d] => Ok((Vec2::new(a, b), Vec2::new(c, d))),
            _ => Err(CorridorError::Wall(number + 1)),
        }
    };
    let walls = walls.lines().enumerate().skip(1).map(wall).collect::<Result<Vec<_>, _>>()?;
    let log: Log = serde_json::from_str(scans)?;
    let pose = |[x, y, theta]: [f64; 3]| Pose::new(x, y, theta);
    let beams = log.scans.iter().map(|scan| scan.ranges.len()).max().unwrap_or(0);
    let lidar = Lidar { beams, field_of_view: -2.0 * log.angle_min, range_min: 0.05, range_max: log.range_max };
    let poses = log.scans.iter().map(|scan| pose(scan.pose_true)).collect();
    let scans = log.scans.into_iter().map(|scan| LaserScan {
        pose: pose(scan.pose_true),
        pose_covariance: None,
        sigma_range: None,
        frame: 0,
        angle_min: log.angle_min,
        angle_increment: log.angle_increment,
        range_min: lidar.range_min,
        // What is as far as the scanner reaches met nothing.
        range_max: 0.999 * log.range_max,
        ranges: scan.ranges.into_iter().map(|range| range.unwrap_or(f64::NAN)).collect(),
    });
    Ok(Survey { plan: Plan { walls: dedup(walls) }, lidar, poses, scans: scans.collect() })
}

/// Walls without those that are points or another's repeat.
fn dedup(walls: Vec<(Vec2, Vec2)>) -> Vec<(Vec2, Vec2)> {
    let key = |&(a, b): &(Vec2, Vec2)| {
        let [a, b] = [a, b].map(|p| [(p.x * 1e4).round() as i64, (p.y * 1e4).round() as i64]);
        if a <= b { (a, b) } else { (b, a) }
    };
    let mut seen = std::collections::BTreeSet::new();
    walls.into_iter().filter(|wall| (wall.1 - wall.0).norm() > 1e-6 && seen.insert(key(wall))).collect()
}
