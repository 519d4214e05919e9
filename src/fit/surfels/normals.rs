//! The direction of the surface at every return, from its neighbours in the scan.
//!
//! Three windows of neighbouring beams are tried, one to either side and one around the return; the straightest wins,
//! so a corner does not round the normals beside it. Beams of one scan share their pose's error, which therefore turns
//! nothing by more than its heading.

use crate::geometry::Vec2;
use crate::scan::Return;

/// Beams to either side that a window spans at most.
const WIDEST: usize = 12;
/// A window reaches this many cells from its return.
const WINDOW: f64 = 1.5;
/// A one-sided window must be this much straighter than the one around the return.
const PREFER_AROUND: f64 = 0.5;

/// A unit normal a return, away from the scanner; along the beam where no neighbour is near.
pub fn outward(returns: &[Return], h: f64) -> Vec<Vec2> {
    (0..returns.len())
        .map(|k| {
            let own = &returns[k];
            let (before, after) = (run(returns, k, -1, h), run(returns, k, 1, h));
            let windows = [(k - before, k + after), (k - before, k), (k, k + after)];
            let lines = windows.map(|(first, last)| line(&returns[first..=last]));
            let around = lines[0].map(|(normal, variance)| (normal, variance * PREFER_AROUND));
            let best = [around, lines[1], lines[2]].into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1));
            let across = best.map_or(own.direction, |(normal, _)| normal);
            if across.dot(&own.direction) < 0.0 { -across } else { across }
        })
        .collect()
}

/// How many neighbours to one side belong to the return's window.
fn run(returns: &[Return], k: usize, step: isize, h: f64) -> usize {
    let own = &returns[k];
    (1..=WIDEST)
        .take_while(|&n| {
            let other = k.checked_add_signed(step * n as isize).and_then(|at| returns.get(at));
            other.is_some_and(|other| {
                other.scan == own.scan
                    && other.beam.abs_diff(own.beam) <= n + 2
                    && (other.point - own.point).norm() <= WINDOW * h
            })
        })
        .count()
}

/// The least-squares line's normal, and the variance across it; `None` for fewer than three returns.
fn line(window: &[Return]) -> Option<(Vec2, f64)> {
    let count = window.len() as f64;
    if count < 3.0 {
        return None;
    }
    let mean: Vec2 = window.iter().map(|seen| seen.point).sum::<Vec2>() / count;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for seen in window {
        let d = seen.point - mean;
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
    }
    let half = 0.5 * (2.0 * xy).atan2(xx - yy);
    let across = Vec2::new(-half.sin(), half.cos());
    let variance = across.x * across.x * xx + 2.0 * across.x * across.y * xy + across.y * across.y * yy;
    // Two unknowns: a short window is straight by accident.
    Some((across, (variance + 1e-12) / (count - 2.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::scan::{Noise, returns_of};
    use crate::sim::{Lidar, World, simulate};

    #[test]
    fn normals_point_away_and_keep_to_their_wall_up_to_the_corner() {
        let room = World::room(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
        let noise = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range: 0.002 };
        let scans = simulate(&room, &Lidar::of_degrees(360, 359.0), &[Pose::new(1.7, 2.2, 0.4)], &noise, 1);
        let returns = returns_of(&scans);
        for (seen, normal) in returns.iter().zip(outward(&returns, 0.25)) {
            assert!((normal.norm() - 1.0).abs() < 1e-12 && normal.dot(&seen.direction) >= 0.0);
            let corner = (seen.point - Vec2::new(2.0, 2.0)).map(f64::abs);
            if corner.min() < 1.9 {
                assert!(normal.amax() > 0.98, "{:?} at {:?}", normal, seen.point);
            }
        }
    }
}
