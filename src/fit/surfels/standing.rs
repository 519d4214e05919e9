//! What stands, and what only stood there for a while: people, doors, reflections in glass.
//!
//! A vector field explains a stray return by a small surface around it, and no robust loss on residuals objects. But
//! beams of other scans passed through where a person was. A surfel stands where at least [`LEAST_STOPPED`] of the
//! scans that looked at it squarely were stopped there; the others saw farther. Beams that only graze its surface are
//! not asked: they run beside walls.

use super::{Surfel, Surfels};
use crate::geometry::{Bounds, Pose, wrap_angle};
use crate::scan::LaserScan;

/// The share of scans that a standing surface stops.
const LEAST_STOPPED: f64 = 0.4;
/// A beam that meets a surface at less than this sine grazes it.
const SQUARE: f64 = 0.35;
/// Pairs of surfel and scan between two questions whether to go on.
const BREATH: usize = 2_000_000;
/// A beam passes a surfel when it goes on for this many cells more.
const MARGIN: f64 = 1.0;

/// For every surfel whether it stands, or `None` where `go_on`, asked every so often, said no.
pub fn standing(
    surfels: &Surfels,
    scans: &[LaserScan],
    poses: &[Pose],
    h: f64,
    go_on: &mut dyn FnMut() -> bool,
) -> Option<Vec<bool>> {
    let extents: Vec<Bounds> = scans.iter().zip(poses).map(|(scan, pose)| extent(scan, pose)).collect();
    let stands = |surfel: &Surfel| {
        let most_passes = surfels.witnesses(surfel).len() as f64 * (1.0 / LEAST_STOPPED - 1.0);
        let views = scans.iter().zip(poses).zip(&extents);
        let mut passes = views
            .filter(|(_, extent)| extent.contains(surfel.anchor))
            .filter(|((scan, pose), _)| passed(surfel, scan, pose, MARGIN * h));
        passes.nth(most_passes as usize).is_none()
    };
    let a_breath = (BREATH / scans.len().max(1)).max(1);
    let mut asked = |k: usize| !k.is_multiple_of(a_breath) || go_on();
    surfels.all.iter().enumerate().map(|(k, surfel)| asked(k).then(|| stands(surfel))).collect()
}

/// The rectangle around a scanner and what it met, and so around everything its beams passed between two returns.
fn extent(scan: &LaserScan, pose: &Pose) -> Bounds {
    let returns = (0..scan.ranges.len()).filter_map(|beam| Some(pose.project(scan.range(beam)?, scan.bearing(beam))));
    let none = Bounds { min: [pose.x, pose.y], max: [pose.x, pose.y] };
    Bounds::around(returns.chain([pose.position()])).unwrap_or(none)
}

/// Whether the beams on either side of a surfel went on behind it.
fn passed(surfel: &Surfel, scan: &LaserScan, pose: &Pose, margin: f64) -> bool {
    let offset = surfel.anchor - pose.position();
    let distance = offset.norm();
    if surfel.normal.dot(&offset).abs() < SQUARE * distance {
        return false;
    }
    let middle = (scan.ranges.len() as f64 - 1.0) / 2.0;
    let from_middle =
        wrap_angle(offset.y.atan2(offset.x) - pose.theta - scan.bearing(0) - middle * scan.angle_increment);
    let beam = middle + from_middle / scan.angle_increment;
    if !(0.0..=2.0 * middle).contains(&beam) {
        return false;
    }
    let beyond = |beam: f64| scan.range(beam as usize).is_some_and(|range| range > distance + margin);
    beyond(beam.floor()) && beyond(beam.ceil())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::vector::tests::corridor;
    use crate::geometry::Vec2;

    #[test]
    fn a_person_that_other_scans_see_through_does_not_stand_and_walls_do() {
        let person = Vec2::new(4.0, 0.7);
        let (scans, surfels) = corridor(&[person]);
        let poses: Vec<Pose> = scans.iter().map(|scan| scan.pose).collect();
        let stands = standing(&surfels, &scans, &poses, 0.25, &mut || true).unwrap();
        let near = |surfel: &Surfel| (surfel.anchor - person).norm() < 0.4;
        let (people, walls): (Vec<_>, Vec<_>) = surfels.all.iter().zip(stands).partition(|(surfel, _)| near(surfel));
        assert!(people.len() > 3 && people.iter().all(|(_, stands)| !stands));
        let fallen = walls.iter().filter(|(_, stands)| !stands).count();
        assert!(fallen * 50 < walls.len(), "{fallen} of {} pieces of wall", walls.len());
    }
}
