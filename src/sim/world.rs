//! A room bounded by a polygon, with polygonal pillars in it.

use super::lidar::Scene;
use crate::geometry::{Bounds, Vec2, nearest_on_segment};

/// Free space inside `outline` and outside every pillar. The corners' orientation does not matter.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    pub outline: Vec<Vec2>,
    pub pillars: Vec<Vec<Vec2>>,
}

impl World {
    /// A room without pillars.
    pub fn room(corners: &[[f64; 2]]) -> Self {
        Self { outline: corners.iter().map(|c| Vec2::new(c[0], c[1])).collect(), pillars: Vec::new() }
    }

    /// The room of the method's experiment 1: an L of 8 m with an inner corner at (4, 4).
    pub fn l_room() -> Self {
        Self::room(&[[0.0, 0.0], [8.0, 0.0], [8.0, 4.0], [4.0, 4.0], [4.0, 8.0], [0.0, 8.0]])
    }

    /// A U of 8 m: two arms joined at the bottom.
    pub fn u_room() -> Self {
        Self::room(&[[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [5.0, 8.0], [5.0, 3.0], [3.0, 3.0], [3.0, 8.0], [0.0, 8.0]])
    }

    /// A T: a bar of 9 m by 3 m on a stem of 3 m by 5 m.
    pub fn t_room() -> Self {
        Self::room(&[[3.0, 0.0], [6.0, 0.0], [6.0, 5.0], [9.0, 5.0], [9.0, 8.0], [0.0, 8.0], [0.0, 5.0], [3.0, 5.0]])
    }

    /// A hall of 9 m by 7 m with a square pillar, one on its corner and a triangular one.
    pub fn pillar_room() -> Self {
        let mut hall = Self::room(&[[0.0, 0.0], [9.0, 0.0], [9.0, 7.0], [0.0, 7.0]]);
        let pillar = |corners: &[[f64; 2]]| corners.iter().map(|c| Vec2::new(c[0], c[1])).collect();
        hall.pillars = vec![
            pillar(&[[2.0, 2.0], [3.2, 2.0], [3.2, 3.2], [2.0, 3.2]]),
            pillar(&[[6.5, 1.6], [7.4, 2.5], [6.5, 3.4], [5.6, 2.5]]),
            pillar(&[[3.6, 4.6], [5.4, 4.6], [4.5, 5.9]]),
        ];
        hall
    }

    /// An office like a comb: a corridor 3 m wide along the bottom of a square, and rooms 3 m wide behind walls of 1 m
    /// that open into it. `side` is rounded to whole rooms.
    pub fn comb_office(side: f64) -> Self {
        let teeth = ((side + 1.0) / 4.0).round().max(1.0) as usize;
        let side = 4.0 * teeth as f64 - 1.0;
        let mut corners = vec![[0.0, 0.0], [side, 0.0]];
        for tooth in (0..teeth).rev() {
            let left = 4.0 * tooth as f64;
            if tooth + 1 < teeth {
                corners.push([left + 3.0, 3.0]);
            }
            corners.extend([[left + 3.0, side], [left, side]]);
            if tooth > 0 {
                corners.push([left, 3.0]);
            }
        }
        Self::room(&corners)
    }

    /// Every wall as a segment.
    pub fn walls(&self) -> impl Iterator<Item = (Vec2, Vec2)> + '_ {
        std::iter::once(&self.outline).chain(&self.pillars).flat_map(|corners| edges(corners))
    }

    /// Every corner.
    pub fn corners(&self) -> impl Iterator<Item = Vec2> + '_ {
        std::iter::once(&self.outline).chain(&self.pillars).flatten().copied()
    }

    /// The rectangle around the outline; an outline without corners gives an empty one at the origin.
    pub fn bounds(&self) -> Bounds {
        Bounds::around(self.outline.iter().copied()).unwrap_or(Bounds { min: [0.0; 2], max: [0.0; 2] })
    }

    /// Whether a point lies in free space.
    pub fn is_free(&self, p: Vec2) -> bool {
        inside(&self.outline, p) && !self.pillars.iter().any(|pillar| inside(pillar, p))
    }

    /// The distance to the nearest wall, negative in free space.
    pub fn signed_distance(&self, p: Vec2) -> f64 {
        let distance = (self.nearest(p) - p).norm();
        if self.is_free(p) { -distance } else { distance }
    }

    /// The point of the walls nearest to `p`.
    pub fn nearest(&self, p: Vec2) -> Vec2 {
        self.walls()
            .map(|(a, b)| nearest_on_segment(p, a, b))
            .min_by(|one, other| (one - p).norm_squared().total_cmp(&(other - p).norm_squared()))
            .unwrap_or(p)
    }

    /// Whether nothing stands between a free point and a point on a wall (or in free space).
    pub fn sees(&self, from: Vec2, target: Vec2) -> bool {
        let offset = target - from;
        let distance = offset.norm();
        distance == 0.0 || self.cast(from, offset / distance).is_none_or(|range| range >= distance - 1e-9)
    }

    /// Points along the walls, `step` metres apart, none of them a corner.
    pub fn boundary(&self, step: f64) -> Vec<Vec2> {
        self.walls()
            .flat_map(|(a, b)| {
                let pieces = ((b - a).norm() / step).ceil().max(1.0);
                (0..pieces as usize).map(move |k| a + (b - a) * ((k as f64 + 0.5) / pieces))
            })
            .collect()
    }

    /// Whether a point is farther than `reach` from every place of free space that has two nearest walls: where the
    /// distance is smooth. Judged by how the distance falls along its own gradient.
    pub fn is_smooth(&self, p: Vec2, reach: f64) -> bool {
        let turn = |k: usize| Vec2::new((k as f64).cos(), (k as f64).sin()) * reach;
        let Some(direction) = self.away_from_wall(p) else { return false };
        (0..7).all(|k| self.away_from_wall(p + turn(k)).is_some_and(|other| other.dot(&direction) > 0.9))
    }

    fn away_from_wall(&self, p: Vec2) -> Option<Vec2> {
        let e = 1e-6;
        let slope = |d: Vec2| (self.signed_distance(p + d) - self.signed_distance(p - d)) / (2.0 * e);
        Vec2::new(slope(Vec2::new(e, 0.0)), slope(Vec2::new(0.0, e))).try_normalize(0.5)
    }
}

impl Scene for World {
    fn cast(&self, from: Vec2, direction: Vec2) -> Option<f64> {
        self.walls().filter_map(|(a, b)| hit(from, direction, a, b)).min_by(f64::total_cmp)
    }
}

fn edges(corners: &[Vec2]) -> impl Iterator<Item = (Vec2, Vec2)> + '_ {
    (0..corners.len()).map(|k| (corners[k], corners[(k + 1) % corners.len()]))
}

/// Even-odd rule.
fn inside(corners: &[Vec2], p: Vec2) -> bool {
    edges(corners)
        .filter(|(a, b)| (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y))
        .count()
        % 2
        == 1
}

/// How far a wall is along a unit direction, where the ray meets it.
pub(super) fn hit(from: Vec2, direction: Vec2, a: Vec2, b: Vec2) -> Option<f64> {
    let wall = b - a;
    let cross = direction.perp(&wall);
    if cross == 0.0 {
        return None;
    }
    let along_wall = (a - from).perp(&direction) / cross;
    let range = (a - from).perp(&wall) / cross;
    ((0.0..=1.0).contains(&along_wall) && range > 1e-9).then_some(range)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_in_the_l_room_are_exact() {
        let room = World::l_room();
        assert!((room.signed_distance(Vec2::new(1.0, 3.0)) + 1.0).abs() < 1e-12);
        assert!((room.signed_distance(Vec2::new(5.0, 5.0)) - 1.0).abs() < 1e-12);
        assert!((room.signed_distance(Vec2::new(3.7, 3.6)) + 0.5).abs() < 1e-12);
        assert!((room.cast(Vec2::new(1.0, 3.0), Vec2::new(1.0, 0.0)).unwrap() - 7.0).abs() < 1e-12);
    }

    #[test]
    fn the_inner_corner_hides_what_is_behind_it() {
        let room = World::l_room();
        assert!(!room.sees(Vec2::new(7.0, 2.0), Vec2::new(2.0, 8.0)));
        assert!(room.sees(Vec2::new(1.5, 1.5), Vec2::new(2.0, 8.0)));
    }

    #[test]
    fn a_pillar_is_not_free() {
        let mut room = World::l_room();
        room.pillars.push(vec![Vec2::new(1.0, 1.0), Vec2::new(2.0, 1.0), Vec2::new(2.0, 2.0), Vec2::new(1.0, 2.0)]);
        assert!(!room.is_free(Vec2::new(1.5, 1.5)));
        assert!((room.signed_distance(Vec2::new(1.5, 1.4)) - 0.4).abs() < 1e-12);
    }

    #[test]
    fn smooth_places_keep_off_the_medial_axis() {
        let room = World::l_room();
        assert!(room.is_smooth(Vec2::new(0.5, 3.0), 0.2));
        assert!(!room.is_smooth(Vec2::new(0.5, 0.55), 0.2));
    }
}
