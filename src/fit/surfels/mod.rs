//! Returns gathered into surfels: short pieces of surface, each with a place, a normal and how far the returns lie off
//! it.
//!
//! Asking a field to vanish at every scattered return flattens it (errors in variables), and costs a row a return. Here
//! the returns of a small square that face one way become one row. Its anchor `a` and normal `n` are the
//! neighbourhood's consensus, a weighted local line (Cleveland's LOESS across the surface), and its returns say where
//! along `n` the surface lies:
//!
//! ```text
//! delta = sum over scans w_s n.(mean of its returns - a) / W        W = sum of w_s
//! 1 / w_s = sigma_r^2 mean (n.d)^2 / count + |R^T J^T n|^2 + sigma_m^2
//! ```
//!
//! The scatter is in `delta`, a number that a fit is held against, and not in where it is held. The returns of one scan
//! share its pose's error, so however many they are, they count as one witness. A wall seen from both sides has
//! surfels of its own on each face.

mod consensus;
pub mod normals;
pub mod standing;

use std::ops::Range;

use nalgebra::Vector3;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use self::consensus::{Neighbourhood, consensus, neighbours};
use super::viewpoint::Viewpoint;
use crate::geometry::{Cov2, Pose, Vec2, turned};
use crate::scan::Return;

/// Squares along a lattice cell's side in which returns are gathered.
const SQUARES: f64 = 4.0;
/// Directions that are told apart within a square.
const SECTORS: f64 = 8.0;
/// A piece of surface that nothing adjoins reaches this many cells to that side.
const LONELY_REACH: f64 = 0.125;

/// Nothing is known better than to a micrometre: a grazing beam's range says nothing, exactly.
const LEAST_VARIANCE: f64 = 1e-12;

/// A piece of surface; see the module.
#[derive(Debug, Clone, PartialEq)]
pub struct Surfel {
    pub anchor: Vec2,
    /// Unit, away from the scanner.
    pub normal: Vec2,
    /// How far the piece reaches along the surface, against and along the normal's quarter turn, metres.
    pub reach: [f64; 2],
    /// Whether the surface goes on beyond that.
    pub goes_on: [bool; 2],
    /// `delta`, metres.
    pub offset: f64,
    /// `W`, per square metre.
    pub weight: f64,
    witnesses: Range<usize>,
}

impl Surfel {
    /// Where the piece begins and ends.
    pub fn ends(&self) -> (Vec2, Vec2) {
        let along = turned(self.normal);
        (self.anchor - along * self.reach[0], self.anchor + along * self.reach[1])
    }
}

/// What one scan's returns know of a surfel's place along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Witness {
    pub scan: usize,
    /// Its returns.
    pub count: f64,
    /// `delta` by this scan alone, metres.
    pub offset: f64,
    /// `w_s`, per square metre.
    pub weight: f64,
    /// The variance that the ranges give to `offset`, square metres.
    pub range_variance: f64,
    /// The derivative of `offset` by the scan's three pose unknowns.
    pub by_pose: Vector3<f64>,
    /// The mean of its returns where they were gathered.
    gathered: Vec2,
}

/// All surfels of a job.
#[derive(Debug, Clone, Default)]
pub struct Surfels {
    pub all: Vec<Surfel>,
    witnesses: Vec<Witness>,
}

/// The returns of one scan in one square: their sums.
struct Group {
    scan: usize,
    count: f64,
    mean: Vec2,
    /// The mean of `d d^T`.
    along: Cov2,
}

/// One square's returns that face one way.
struct Patch {
    center: Vec2,
    normal: Vec2,
    groups: Range<usize>,
    /// `W` for the first normal: what the consensus weighs it by.
    weight: f64,
}

impl Surfels {
    /// Gathers returns, and says for each to which surfel it went. `h` is the lattice's resolution, `normals` has a unit
    /// vector for each return, away from its scanner.
    pub fn gather(returns: &[Return], normals: &[Vec2], viewpoints: &[Viewpoint], h: f64) -> (Self, Vec<usize>) {
        let (patches, groups, owners) = patches(returns, normals, viewpoints, h);
        let places = patches.iter().enumerate().map(|(k, patch)| GeomWithData::new(patch.center.into(), k)).collect();
        let around = Neighbourhood { patches: &patches, tree: RTree::bulk_load(places), h };
        let mut surfels = Self::default();
        for patch in &patches {
            let (anchor, normal) = consensus(patch, &around);
            let next = neighbours(anchor, normal, &around);
            surfels.push((anchor, normal), (next, LONELY_REACH * h), &groups[patch.groups.clone()], viewpoints);
        }
        (surfels, owners)
    }

    /// Drops the surfels without a mark, and gives the share of the returns that stay. Where there is no mark at all,
    /// all stay.
    pub fn keep(&mut self, marks: &[bool]) -> f64 {
        if !marks.contains(&true) {
            return 1.0;
        }
        let count = |own: &[Surfel], witnesses: &[Witness]| -> f64 {
            own.iter().flat_map(|surfel| &witnesses[surfel.witnesses.clone()]).map(|witness| witness.count).sum()
        };
        let before = count(&self.all, &self.witnesses);
        let mut mark = marks.iter();
        self.all.retain(|_| mark.next().copied().unwrap_or(true));
        count(&self.all, &self.witnesses) / before
    }

    /// Moves what the scans know with their poses, from where returns were gathered to where they are put now. Anchors,
    /// normals, weights and which returns belong together stay.
    pub fn reproject(&mut self, gathered: &[Pose], put: &[Pose], viewpoints: &[Viewpoint]) {
        for surfel in &mut self.all {
            let own = &mut self.witnesses[surfel.witnesses.clone()];
            for witness in own.iter_mut() {
                let (from, to) = (&gathered[witness.scan], &put[witness.scan]);
                let (sin, cos) = (to.theta - from.theta).sin_cos();
                let arm = witness.gathered - from.position();
                let arm = Vec2::new(cos * arm.x - sin * arm.y, sin * arm.x + cos * arm.y);
                witness.offset = surfel.normal.dot(&(to.position() + arm - surfel.anchor));
                witness.by_pose = by_pose(&viewpoints[witness.scan], surfel.normal, arm);
            }
            surfel.offset = own.iter().map(|witness| witness.weight * witness.offset).sum::<f64>() / surfel.weight;
        }
    }

    /// What the scans know of a surfel, one by one.
    pub fn witnesses(&self, surfel: &Surfel) -> &[Witness] {
        &self.witnesses[surfel.witnesses.clone()]
    }

    fn push(
        &mut self,
        (anchor, normal): (Vec2, Vec2),
        (next, lonely_reach): ([Option<f64>; 2], f64),
        groups: &[Group],
        viewpoints: &[Viewpoint],
    ) {
        let first = self.witnesses.len();
        self.witnesses.extend(groups.iter().map(|group| Witness::of(group, anchor, normal, viewpoints)));
        let own = &self.witnesses[first..];
        let weight: f64 = own.iter().map(|witness| witness.weight).sum();
        let offset = own.iter().map(|witness| witness.weight * witness.offset).sum::<f64>() / weight;
        let reach = next.map(|t| t.map_or(lonely_reach, |t| 0.5 * t));
        let goes_on = next.map(|t| t.is_some());
        self.all.push(Surfel {
            anchor,
            normal,
            reach,
            goes_on,
            offset,
            weight,
            witnesses: first..self.witnesses.len(),
        });
    }
}

impl Witness {
    fn of(group: &Group, anchor: Vec2, normal: Vec2, viewpoints: &[Viewpoint]) -> Self {
        let viewpoint = &viewpoints[group.scan];
        let by_pose = by_pose(viewpoint, normal, group.mean - viewpoint.position);
        let range_variance = viewpoint.noise.range_variance * mean_square(&group.along, normal) / group.count;
        let own = if viewpoint.noise.pose.is_some() { by_pose.norm_squared() } else { 0.0 };
        let weight = 1.0 / (range_variance + own + viewpoint.noise.model_variance).max(LEAST_VARIANCE);
        Self {
            scan: group.scan,
            count: group.count,
            offset: normal.dot(&(group.mean - anchor)),
            weight,
            range_variance,
            by_pose,
            gathered: group.mean,
        }
    }
}

/// The mean square of what beams have along a normal, of `along`, the mean of their directions' outer products. Beams that
/// run beside a surface have nothing, which rounding makes a little less than nothing, and a root of that no number.
fn mean_square(along: &Cov2, normal: Vec2) -> f64 {
    normal.dot(&(along * normal)).max(0.0)
}

/// How a place at `arm` from its scanner moves along a normal with its pose's unknowns.
fn by_pose(viewpoint: &Viewpoint, normal: Vec2, arm: Vec2) -> Vector3<f64> {
    viewpoint.root.transpose() * Vector3::new(normal.x, normal.y, normal.dot(&turned(arm)))
}

/// The patches, the groups they are made of, and the patch of each return.
fn patches(
    returns: &[Return],
    normals: &[Vec2],
    viewpoints: &[Viewpoint],
    h: f64,
) -> (Vec<Patch>, Vec<Group>, Vec<usize>) {
    let side = h / SQUARES;
    let key = |k: usize| {
        let (p, n) = (returns[k].point, normals[k]);
        let sector = (n.y.atan2(n.x) / std::f64::consts::TAU * SECTORS).round().rem_euclid(SECTORS);
        ((p.y / side).floor() as i64, (p.x / side).floor() as i64, sector as u8)
    };
    let mut order: Vec<_> = (0..returns.len()).map(|k| (key(k), returns[k].scan, k)).collect();
    order.sort_unstable();
    let (mut patches, mut groups, mut owners) = (Vec::new(), Vec::new(), vec![0; returns.len()]);
    for square in order.chunk_by(|a, b| a.0 == b.0) {
        let first = groups.len();
        square.iter().for_each(|&(_, _, k)| owners[k] = patches.len());
        let facing: Vec2 = square.iter().map(|&(_, _, k)| normals[k]).sum();
        let normal = facing.try_normalize(1e-9).unwrap_or(normals[square[0].2]);
        groups
            .extend(square.chunk_by(|a, b| a.1 == b.1).map(|own| group(own[0].1, own.iter().map(|at| &returns[at.2]))));
        let weights = groups[first..].iter().map(|group| Witness::of(group, group.mean, normal, viewpoints).weight);
        let (mut weight, mut center) = (0.0, Vec2::zeros());
        for (own, group) in weights.zip(&groups[first..]) {
            weight += own;
            center += group.mean * own;
        }
        patches.push(Patch { center: center / weight, normal, groups: first..groups.len(), weight });
    }
    (patches, groups, owners)
}

fn group<'a>(scan: usize, own: impl Iterator<Item = &'a Return>) -> Group {
    let mut group = Group { scan, count: 0.0, mean: Vec2::zeros(), along: Cov2::zeros() };
    for seen in own {
        group.count += 1.0;
        group.mean += seen.point;
        group.along += seen.direction * seen.direction.transpose();
    }
    group.mean /= group.count;
    group.along /= group.count;
    group
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Cov3, Pose};
    use crate::scan::{LaserScan, Noise, ReturnNoise, returns_of};
    use crate::sim::{Lidar, World, misplaced, simulate};

    const H: f64 = 0.25;

    fn viewpoints(scans: &[LaserScan], noise: &Noise) -> Vec<Viewpoint> {
        let viewpoint = |scan: &LaserScan| Viewpoint {
            position: scan.pose.position(),
            frame: 0,
            root: Cov3::from_diagonal(&nalgebra::Vector3::new(noise.sigma_x, noise.sigma_y, noise.sigma_theta)),
            noise: ReturnNoise { pose: None, range_variance: noise.sigma_range.powi(2), model_variance: 1e-6 },
        };
        scans.iter().map(viewpoint).collect()
    }

    /// A square room of 6 m, seen twice from its middle and misplaced.
    fn square() -> (Vec<LaserScan>, Vec<Return>, Surfels) {
        let room = World::room(&[[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]]);
        let exact = Noise { sigma_x: 0.0, sigma_y: 0.0, sigma_theta: 0.0, sigma_range: 0.02 };
        let poses = [Pose::new(3.0, 3.0, 0.2), Pose::new(2.6, 3.2, 1.7)];
        let scans = simulate(&room, &Lidar::of_degrees(360, 359.0), &poses, &exact, 5);
        let scans = misplaced(&scans, &Noise { sigma_x: 0.03, sigma_y: 0.03, sigma_theta: 0.002, sigma_range: 0.0 }, 2);
        let returns = returns_of(&scans);
        let normals = normals::outward(&returns, H);
        let (surfels, _) = Surfels::gather(&returns, &normals, &viewpoints(&scans, &Noise::EXPERIMENT_ONE), H);
        (scans, returns, surfels)
    }

    fn wall_error(p: Vec2) -> f64 {
        [p.x, 6.0 - p.x, p.y, 6.0 - p.y].into_iter().fold(f64::INFINITY, |near, d| near.min(d.abs()))
    }

    #[test]
    fn anchors_lie_nearer_to_the_wall_than_returns_and_normals_across_it() {
        let (_, returns, surfels) = square();
        let rms = |v: Vec<f64>| (v.iter().map(|d| d * d).sum::<f64>() / v.len() as f64).sqrt();
        let scattered = rms(returns.iter().map(|seen| wall_error(seen.point)).collect());
        let anchored = rms(surfels.all.iter().map(|surfel| wall_error(surfel.anchor)).collect());
        assert!(anchored < 0.75 * scattered, "{anchored} {scattered}");
        let tilt =
            surfels.all.iter().filter(|s| (s.anchor - Vec2::new(3.0, 3.0)).amax() > 2.7).map(|s| s.normal.amax());
        let mut tilt: Vec<f64> = tilt.collect();
        tilt.sort_by(f64::total_cmp);
        assert!(tilt[tilt.len() / 20] > 0.99, "the worst twentieth: {}", tilt[tilt.len() / 20]);
    }

    #[test]
    fn beams_that_run_beside_a_surface_have_a_range_variance_with_a_root() {
        for k in 0..10_000 {
            let (sin, cos) = (f64::from(k) * 1e-3).sin_cos();
            let direction = Vec2::new(cos, sin);
            let along = mean_square(&(direction * direction.transpose()), turned(direction));
            assert!((0.0..1e-15).contains(&along), "{along} at {k}");
        }
    }

    #[test]
    fn a_surfel_says_where_its_returns_lie_and_how_a_pose_moves_them() {
        let (scans, _, surfels) = square();
        let viewpoints = viewpoints(&scans, &Noise::EXPERIMENT_ONE);
        for surfel in &surfels.all {
            let own = surfels.witnesses(surfel);
            let weight: f64 = own.iter().map(|w| w.weight).sum();
            let offset: f64 = own.iter().map(|w| w.weight * w.offset).sum::<f64>() / weight;
            assert!((surfel.weight - weight).abs() < 1e-9 * weight && (surfel.offset - offset).abs() < 1e-12);
            for witness in own {
                // A scan moved along the normal moves its returns by as much.
                let along = viewpoints[witness.scan].root.try_inverse().unwrap()
                    * nalgebra::Vector3::new(surfel.normal.x, surfel.normal.y, 0.0);
                assert!((witness.by_pose.dot(&along) - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_share_of_the_returns_goes_with_the_surfels_that_are_dropped() {
        let (_, returns, mut surfels) = square();
        let (before, first) = (surfels.all.len(), surfels.all[0].clone());
        let dropped: f64 = surfels.witnesses(&first).iter().map(|w| w.count).sum();
        let stay = surfels.keep(&(0..before).map(|k| k > 0).collect::<Vec<_>>());
        assert_eq!(surfels.all.len(), before - 1);
        assert!((stay - (1.0 - dropped / returns.len() as f64)).abs() < 1e-12);
    }
}
