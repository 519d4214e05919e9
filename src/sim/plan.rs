//! A floor plan: walls as segments, with space on either side of them.
//!
//! Where a [`World`](super::World) has an inside, a plan has none: the truth for a vector map is the nearest point of
//! any wall.

use super::lidar::{Lidar, Scene};
use super::world::hit;
use crate::geometry::{Pose, Vec2, nearest_on_segment, turned, wrap_angle};

/// Walls of a building.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    pub walls: Vec<(Vec2, Vec2)>,
}

/// A target on a wall is in view although its own wall is that near to the end of the ray, metres.
const TOUCH: f64 = 1e-4;

impl Plan {
    /// The point of the walls nearest to `p`.
    pub fn nearest(&self, p: Vec2) -> Vec2 {
        self.walls
            .iter()
            .map(|&(a, b)| nearest_on_segment(p, a, b))
            .min_by(|one, other| (one - p).norm_squared().total_cmp(&(other - p).norm_squared()))
            .unwrap_or(p)
    }

    /// Whether nothing stands between two points.
    pub fn sees(&self, from: Vec2, target: Vec2) -> bool {
        let offset = target - from;
        let distance = offset.norm();
        distance == 0.0 || self.cast(from, offset / distance).is_none_or(|range| range >= distance - TOUCH)
    }

    /// Whether a scanner at some pose has a point in view.
    pub fn in_view(&self, lidar: &Lidar, poses: &[Pose], p: Vec2) -> bool {
        poses.iter().any(|pose| {
            let offset = p - pose.position();
            let bearing = wrap_angle(offset.y.atan2(offset.x) - pose.theta);
            bearing.abs() <= lidar.field_of_view / 2.0
                && offset.norm() <= lidar.range_max
                && self.sees(pose.position(), p)
        })
    }

    /// Points along the walls, `step` metres of wall apart, each with its wall's unit normal. Walls shorter than a step
    /// are counted together, so that a jagged corner has no more points than its length is worth.
    pub fn boundary(&self, step: f64) -> Vec<(Vec2, Vec2)> {
        let mut points = Vec::new();
        let mut next = 0.5 * step;
        for &(a, b) in &self.walls {
            let length = (b - a).norm();
            let Some(along) = (b - a).try_normalize(1e-9) else { continue };
            while next < length {
                points.push((a + along * next, turned(along)));
                next += step;
            }
            next -= length;
        }
        points
    }

    /// Whether the nearest wall is nearly the same one in a circle around a point: it lies off the cut locus.
    pub fn is_smooth(&self, p: Vec2, reach: f64) -> bool {
        let away = |p: Vec2| (p - self.nearest(p)).try_normalize(1e-9);
        let Some(own) = away(p) else { return true };
        (0..12).map(|k| f64::from(k) * std::f64::consts::TAU / 12.0).all(|turn| {
            let beside = p + Vec2::new(turn.cos(), turn.sin()) * reach;
            // On the wall's other side the direction is the opposite one, and the field smooth all the same.
            (self.nearest(beside) - self.nearest(p)).norm() <= 1.5 * reach
                && away(beside).is_none_or(|other| other.dot(&own).abs() > 0.5)
        })
    }
}

impl Scene for Plan {
    fn cast(&self, from: Vec2, direction: Vec2) -> Option<f64> {
        self.walls.iter().filter_map(|&(a, b)| hit(from, direction, a, b)).min_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corridor_has_its_cut_locus_in_the_middle() {
        let wall = |y: f64| (Vec2::new(0.0, y), Vec2::new(10.0, y));
        let plan = Plan { walls: vec![wall(0.0), wall(2.0)] };
        assert!((plan.nearest(Vec2::new(3.0, 0.4)) - Vec2::new(3.0, 0.0)).norm() < 1e-12);
        assert!(plan.is_smooth(Vec2::new(5.0, 0.5), 0.25) && !plan.is_smooth(Vec2::new(5.0, 0.9), 0.25));
        assert!(
            plan.sees(Vec2::new(1.0, 1.0), Vec2::new(4.0, 0.0)) && !plan.sees(Vec2::new(1.0, 1.0), Vec2::new(1.0, 3.0))
        );
    }
}
