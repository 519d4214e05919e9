//! A building surveyed: its walls, the scanner, where it truly stood, and what it measured there.

use super::lidar::{Lidar, simulate};
use super::plan::Plan;
use crate::geometry::{Pose, Vec2};
use crate::scan::{LaserScan, Noise};

#[derive(Debug, Clone)]
pub struct Survey {
    pub plan: Plan,
    pub lidar: Lidar,
    /// The true poses.
    pub poses: Vec<Pose>,
    /// Taken from the true poses.
    pub scans: Vec<LaserScan>,
}

/// The office's rooms: so many along each side of the corridor, of this size, metres.
const ROOMS: usize = 5;
const ROOM: [f64; 2] = [4.0, 4.0];
const CORRIDOR: f64 = 2.0;
const WALL: f64 = 0.15;
const DOOR: f64 = 1.0;

impl Survey {
    /// An office of our own making, for the method's experiment 2 on any machine: a corridor with five rooms on either
    /// side behind walls 0.15 m thick with doors, a pillar in some of them; 26 scans of 271 beams over 270 degrees, two
    /// in every room.
    pub fn office(sigma_range: f64, seed: u64) -> Self {
        let plan = office();
        let lidar = Lidar { range_max: 20.0, ..Lidar::of_degrees(271, 270.0) };
        let mut poses: Vec<Pose> = (0..6).map(|k| Pose::new(1.5 + 3.4 * k as f64, 5.1, 0.4 * k as f64)).collect();
        for room in 0..ROOMS {
            let x = ROOM[0] * room as f64;
            for (y, heading) in [(1.2, 0.8), (3.2, 2.9), (ROOM[1] + CORRIDOR + 2.8, -0.8), (7.2, -2.4)] {
                poses.push(Pose::new(x + 1.1 + 0.2 * y, y, heading));
            }
        }
        let noise = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range };
        let scans = simulate(&plan, &lidar, &poses, &noise, seed);
        Self { plan, lidar, poses, scans }
    }
}

impl Survey {
    /// A building of `side` x `side` rooms of 4 m, doors of 1 m between all neighbours, two scans of 271 beams a room:
    /// for measuring how cost grows, and whether uncertainty stays true where little is shared.
    pub fn halls(side: usize, sigma_range: f64, seed: u64) -> Self {
        let plan = halls(side);
        let lidar = Lidar { range_max: 12.0, ..Lidar::of_degrees(271, 270.0) };
        let poses: Vec<Pose> = (0..side * side)
            .flat_map(|room| {
                let corner = [ROOM[0] * (room % side) as f64, ROOM[1] * (room / side) as f64];
                let turn = 0.37 * room as f64;
                [(1.3, 1.1, turn), (2.7, 2.8, turn + 2.6)].map(|(x, y, theta)| {
                    Pose::new(corner[0] + x, corner[1] + y, theta.rem_euclid(std::f64::consts::TAU))
                })
            })
            .collect();
        let noise = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range };
        // Every scan meets the walls near it alone, so that a large building is simulated in time.
        let reach = Vec2::from_element(lidar.range_max);
        let scans = poses
            .iter()
            .enumerate()
            .flat_map(|(k, pose)| {
                let (low, high) = (pose.position() - reach, pose.position() + reach);
                let near =
                    |(a, b): &&(Vec2, Vec2)| (0..2).all(|k| a[k].max(b[k]) >= low[k] && a[k].min(b[k]) <= high[k]);
                let around = Plan { walls: plan.walls.iter().filter(near).copied().collect() };
                simulate(&around, &lidar, &[*pose], &noise, seed.wrapping_mul(1_000_003).wrapping_add(k as u64))
            })
            .collect();
        Self { plan, lidar, poses, scans }
    }
}

fn halls(side: usize) -> Plan {
    let mut walls = Vec::new();
    let middle = 0.5 * (ROOM[0] - DOOR);
    for (line, room) in (0..=side).flat_map(|line| (0..side).map(move |room| (line, room))) {
        let (across, along) = (ROOM[0] * line as f64, ROOM[0] * room as f64);
        let pieces = match line > 0 && line < side {
            true => vec![[along, along + middle], [along + middle + DOOR, along + ROOM[0]]],
            false => vec![[along, along + ROOM[0]]],
        };
        for [from, to] in pieces {
            walls.extend(rectangle([across - 0.5 * HALL_WALL, from], [across + 0.5 * HALL_WALL, to]));
            walls.extend(rectangle([from, across - 0.5 * HALL_WALL], [to, across + 0.5 * HALL_WALL]));
        }
    }
    Plan { walls }
}

/// The halls' walls are thicker than a cell of 0.2 m, so that either face has cells of its own.
const HALL_WALL: f64 = 0.4;

fn office() -> Plan {
    let (width, depth) = (ROOM[0] * ROOMS as f64, 2.0 * ROOM[1] + CORRIDOR);
    let mut walls = rectangle([0.0, 0.0], [width, depth]);
    for (row, wall) in [(0.0, ROOM[1]), (ROOM[1] + CORRIDOR, ROOM[1] + CORRIDOR)] {
        for room in 0..ROOMS {
            let x = ROOM[0] * room as f64;
            if room > 0 {
                walls.extend(rectangle([x - 0.5 * WALL, row], [x + 0.5 * WALL, row + ROOM[1]]));
            }
            // The wall to the corridor, with a door in it.
            let door = x + 0.6 + 0.5 * room as f64;
            let y = [wall - 0.5 * WALL, wall + 0.5 * WALL];
            walls.extend(rectangle([x, y[0]], [door, y[1]]));
            walls.extend(rectangle([door + DOOR, y[0]], [x + ROOM[0], y[1]]));
            if room % 2 == 0 {
                walls.extend(rectangle([x + 2.8, row + 2.0], [x + 3.3, row + 2.5]));
            }
        }
    }
    Plan { walls }
}

fn rectangle(low: [f64; 2], high: [f64; 2]) -> Vec<(Vec2, Vec2)> {
    let corners = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
    let corner = |k: usize| Vec2::new(corners[k % 4][0], corners[k % 4][1]);
    (0..4).map(|k| (corner(k), corner(k + 1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_stands_in_a_wall_and_every_room_is_seen() {
        let survey = Survey::office(0.02, 1);
        assert_eq!((survey.poses.len(), survey.scans.len()), (26, 26));
        for pose in &survey.poses {
            assert!((survey.plan.nearest(pose.position()) - pose.position()).norm() > 0.3, "{pose:?}");
        }
        for room in 0..ROOMS {
            for y in [1.5, 8.5] {
                let place = Vec2::new(ROOM[0] * room as f64 + 2.0, y);
                assert!(survey.plan.in_view(&survey.lidar, &survey.poses, place), "{place:?}");
            }
        }
    }
}
