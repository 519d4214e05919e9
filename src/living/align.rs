//! Where maps' frames lie, from guesses: each map's returns are registered against those of the maps placed before it.
//!
//! A guess may be off by decimetres and degrees, far beyond where Gauss-Newton finds home. So first every pose of a window
//! of two and a half standard deviations around it is tried on a raster of how near surfaces are (Olson 2009: correlative
//! scan matching), then the best few are refined by point-to-line registration with a robust loss that narrows from 0.5 m
//! to 5 cm (Geman-McClure, graduated), and the best of them is the frame's place. What follows is a fit of all scans
//! (`fit`), for which this is near enough: here poses are as reported, there they are refined.
//!
//! What could be wrong is looked for, and refused: too little that both see ([`JoinError::Apart`]); a direction that nothing
//! holds, or two places that fit alike ([`JoinError::Undetermined`]); and the best place still bad, because the guess is
//! wrong or the maps show different places ([`JoinError::Mismatch`]).

use nalgebra::{Matrix3, Vector3};
use rstar::RTree;
use rstar::primitives::GeomWithData;
use thiserror::Error;

use super::cloud::{Raster, line_normal, thinned};

use crate::geometry::{Bounds, Cov3, Pose, Vec2, covariance_in_frame, in_frame, turned, turned_by, wrap_angle};
use crate::scan::{Evidence, LaserScan, returns_of};
use crate::spline::Lattice;

/// A guess at where a frame lies, and its covariance in (x, y, theta).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guess {
    pub pose: Pose,
    pub covariance: Cov3,
}

/// Why maps were not joined. A frame is named by its place among the maps of the request.
#[derive(Debug, Error, PartialEq)]
pub enum JoinError {
    #[error(
        "/maps/{frame}: {share:.0} % of what it met lies where the maps before it have seen anything; that is too little to tell where it lies"
    )]
    Apart { frame: usize, share: f64 },
    #[error("/maps/{frame}: where it lies is not determined by what the maps both see: {why}")]
    Undetermined { frame: usize, why: String },
    #[error(
        "/maps/{frame}: {matched:.0} % of its surfaces match those of the maps before it at the best place within the guess's uncertainty; the guess is wrong, or the maps show different places"
    )]
    Mismatch { frame: usize, matched: f64 },
    #[error("/maps/{frame}: its surfaces match best where its frame lies at x {:.2} m, y {:.2} m, theta {:.3}, farther from the guess than the guess's covariance allows", .place.x, .place.y, .place.theta)]
    Far { frame: usize, place: Pose },
    #[error("the joined map would be too large: {0}")]
    Lattice(#[from] crate::spline::LatticeError),
    #[error("cancelled")]
    Cancelled,
}

impl JoinError {
    /// The same, of the map whose frame it is.
    pub fn of_map(self, place: impl Fn(usize) -> usize) -> Self {
        match self {
            Self::Apart { frame, share } => Self::Apart { frame: place(frame), share },
            Self::Undetermined { frame, why } => Self::Undetermined { frame: place(frame), why },
            Self::Mismatch { frame, matched } => Self::Mismatch { frame: place(frame), matched },
            Self::Far { frame, place: at } => Self::Far { frame: place(frame), place: at },
            other => other,
        }
    }
}

/// Standard deviations of the guess that are searched, and the most that is, metres and radians.
const WINDOW: f64 = 2.5;
const WIDEST: [f64; 2] = [4.0, 0.8];
/// Steps of the search, metres and radians, and steps an axis at most.
const STEP: [f64; 2] = [0.1, 0.02];
const MOST_STEPS: f64 = 20.0;
/// Points that are tried.
const TRIED: usize = 400;
/// Places that are refined, and how far apart they are, metres and radians.
const REFINED: usize = 12;
const DISTINCT: [f64; 2] = [0.3, 0.08];
/// The robust scales of the refinement, metres, and its steps at each.
const SCALES: [f64; 6] = [0.5, 0.3, 0.2, 0.12, 0.08, 0.05];
const ROUNDS: usize = 8;
/// A point is matched where a surface is this near, metres.
const MATCHED: f64 = 0.2;
/// Shares, of the points: seen at all by the maps before, at least; of these matched, at least.
const LEAST_SEEN: f64 = 0.1;
const LEAST_POINTS: usize = 60;
const LEAST_MATCHED: f64 = 0.6;
/// The information about the worst direction, as a share of the points that match.
const LEAST_HELD: f64 = 0.03;
/// How far a place may lie from its guess, squared standard deviations: one guess in ten thousand is farther off (three
/// degrees of freedom). What an alignment from reported poses is off by is added to the guess: metres, radians.
const GATE: f64 = 21.1;
const ALIGNED: [f64; 3] = [0.05, 0.05, 0.01];
/// Another place whose score is this share of the best's fits as well.
const RIVAL: f64 = 0.97;

/// The place of every frame in the first one's surroundings; the first is where its guess says. `scans` are in their frames.
pub fn aligned(scans: &[LaserScan], guesses: &[Guess], goes_on: &dyn Fn() -> bool) -> Result<Vec<Pose>, JoinError> {
    let mut places: Vec<Option<Pose>> = vec![None; guesses.len()];
    places[0] = Some(guesses[0].pose);
    let clouds: Vec<Vec<Vec2>> = (0..guesses.len()).map(|frame| cloud(scans, frame)).collect();
    while places.contains(&None) {
        let placed: Vec<LaserScan> =
            scans.iter().filter_map(|scan| Some(moved(scan, places[scan.frame].as_ref()?))).collect();
        let scene = Scene::of(&placed)?;
        // The one that the scene has seen most of.
        let waiting = (0..guesses.len()).filter(|frame| places[*frame].is_none());
        let shares: Vec<(usize, f64)> =
            waiting.map(|frame| (frame, scene.seen_share(&clouds[frame], &guesses[frame].pose))).collect();
        let &(frame, _) =
            shares.iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))).ok_or(JoinError::Cancelled)?;
        places[frame] = Some(scene.place(&clouds[frame], &guesses[frame], frame, goes_on)?);
    }
    Ok(places.into_iter().flatten().collect())
}

/// A scan of a frame, in the frame's surroundings.
pub fn moved(scan: &LaserScan, frame: &Pose) -> LaserScan {
    let covariance = scan.pose_covariance.map(|own| covariance_in_frame(frame, &own));
    LaserScan { pose: in_frame(frame, &scan.pose), pose_covariance: covariance, ..scan.clone() }
}

/// What a frame's scans met, a point a square.
fn cloud(scans: &[LaserScan], frame: usize) -> Vec<Vec2> {
    let own: Vec<LaserScan> = scans.iter().filter(|scan| scan.frame == frame).cloned().collect();
    thinned(returns_of(&own).into_iter().map(|seen| seen.point).collect())
}

/// Maps that are placed.
struct Scene {
    /// Points with the normal of their line, or none at corners and where there are few.
    tree: RTree<GeomWithData<[f64; 2], Option<Vec2>>>,
    lattice: Lattice,
    evidence: Evidence,
    raster: Raster,
}

impl Scene {
    fn of(scans: &[LaserScan]) -> Result<Self, JoinError> {
        let points = thinned(returns_of(scans).into_iter().map(|seen| seen.point).collect());
        let stood = scans.iter().map(|scan| scan.pose.position());
        let bounds = Bounds::around(points.iter().copied().chain(stood)).ok_or(crate::spline::LatticeError::Bounds)?;
        let bounds = bounds.grown(1.0);
        let [width, height] = bounds.size();
        let resolution = (width * height / 4e5).sqrt().max(0.2);
        let lattice = Lattice::covering(&bounds, resolution, 2_000_000)?;
        let bare = RTree::bulk_load(points.iter().map(|p| [p.x, p.y]).collect());
        let lined = points.iter().map(|p| GeomWithData::new([p.x, p.y], line_normal(&bare, *p)));
        let evidence = Evidence::gather(&lattice, scans);
        Ok(Self { tree: RTree::bulk_load(lined.collect()), raster: Raster::of(&points, &bounds), lattice, evidence })
    }

    fn seen_share(&self, cloud: &[Vec2], place: &Pose) -> f64 {
        let seen = |p: &&Vec2| self.evidence.at(&self.lattice, put(place, **p)).any();
        cloud.iter().filter(seen).count() as f64 / cloud.len().max(1) as f64
    }

    fn place(
        &self,
        cloud: &[Vec2],
        guess: &Guess,
        frame: usize,
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Pose, JoinError> {
        let mut best: Vec<(f64, Pose, Matrix3<f64>)> = Vec::new();
        for start in self.candidates(cloud, guess, goes_on)? {
            let (pose, information) = self.refined(cloud, start);
            let score = self.score(cloud, &pose);
            if best.iter().all(|(_, other, _)| distinct(other, &pose)) {
                best.push((score, pose, information));
            }
        }
        best.sort_by(|a, b| b.0.total_cmp(&a.0));
        let Some((score, pose, information)) = best.first() else {
            return Err(JoinError::Apart { frame, share: 0.0 });
        };
        self.check(cloud, (pose, information), frame)?;
        let off = Vector3::new(pose.x - guess.pose.x, pose.y - guess.pose.y, wrap_angle(pose.theta - guess.pose.theta));
        let spread = guess.covariance + Matrix3::from_diagonal(&Vector3::from(ALIGNED.map(|sigma| sigma * sigma)));
        if spread.cholesky().is_none_or(|spread| off.dot(&spread.solve(&off)) > GATE) {
            return Err(JoinError::Far { frame, place: *pose });
        }
        if let Some((_, other, _)) = best.get(1).filter(|other| other.0 >= RIVAL * score) {
            let [dx, dy] = [other.x - pose.x, other.y - pose.y];
            let turn = wrap_angle(other.theta - pose.theta).to_degrees();
            let why = format!("it would lie {:.2} m and {turn:.1} degrees away as well", dx.hypot(dy));
            return Err(JoinError::Undetermined { frame, why });
        }
        Ok(*pose)
    }

    /// The best places of the window by the raster, distinct ones.
    fn candidates(&self, cloud: &[Vec2], guess: &Guess, goes_on: &dyn Fn() -> bool) -> Result<Vec<Pose>, JoinError> {
        let sigma = |k: usize| guess.covariance[(k, k)].sqrt();
        let axis = |k: usize| {
            let (widest, step) = (WIDEST[k / 2], STEP[k / 2]);
            let reach = (WINDOW * sigma(k)).min(widest);
            let steps = (reach / step).ceil().min(MOST_STEPS);
            let stride = if steps > 0.0 { reach / steps } else { 0.0 };
            (-(steps as i64)..=steps as i64).map(move |n| n as f64 * stride).collect::<Vec<f64>>()
        };
        let (xs, ys, turns) = (axis(0), axis(1), axis(2));
        let stride = cloud.len().div_ceil(TRIED).max(1);
        let middle = cloud.iter().sum::<Vec2>() / cloud.len().max(1) as f64;
        let mut tried = Vec::with_capacity(xs.len() * ys.len() * turns.len());
        for turn in &turns {
            if !goes_on() {
                return Err(JoinError::Cancelled);
            }
            let theta = guess.pose.theta + turn;
            let turned = Pose::new(guess.pose.x, guess.pose.y, theta);
            let arms: Vec<Vec2> = cloud.iter().step_by(stride).map(|p| put(&turned, *p)).collect();
            for (dx, dy) in xs.iter().flat_map(|x| ys.iter().map(move |y| (*x, *y))) {
                let shift = Vec2::new(dx, dy);
                let score: f64 = arms.iter().map(|p| self.raster.at(p + shift)).sum();
                tried.push((score, Pose::new(turned.x + dx, turned.y + dy, theta)));
            }
        }
        tried.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Vec<Pose> = Vec::new();
        for (_, pose) in tried {
            let own = put(&pose, middle);
            let far = |other: &Pose| {
                (put(other, middle) - own).norm() > DISTINCT[0] || (other.theta - pose.theta).abs() > DISTINCT[1]
            };
            if best.iter().all(far) {
                best.push(pose);
            }
            if best.len() == REFINED {
                break;
            }
        }
        Ok(best)
    }

    /// Robust point-to-line registration, and the information it ends with, about the cloud's middle, rotation in units of
    /// its extent, as a share of the points that match.
    fn refined(&self, cloud: &[Vec2], start: Pose) -> (Pose, Matrix3<f64>) {
        let (mut pose, mut information) = (start, Matrix3::zeros());
        let middle = cloud.iter().sum::<Vec2>() / cloud.len().max(1) as f64;
        let extent =
            (cloud.iter().map(|p| (p - middle).norm_squared()).sum::<f64>() / cloud.len().max(1) as f64).sqrt();
        for scale in SCALES {
            for _ in 0..ROUNDS {
                let (mut h, mut g, mut all) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros(), 0.0f64);
                let center = put(&pose, middle);
                for p in cloud {
                    let own = put(&pose, *p);
                    let Some((near, d2)) = self.tree.nearest_neighbor_with_distance_2(own.into()) else { continue };
                    if d2 > (3.0 * scale).powi(2) {
                        continue;
                    }
                    let off = own - Vec2::new(near.geom()[0], near.geom()[1]);
                    // Corners hold along both axes, lines across themselves alone.
                    let rows = match near.data {
                        Some(normal) => [Some(normal), None],
                        None => [Some(Vec2::x()), Some(Vec2::y())],
                    };
                    for normal in rows.into_iter().flatten() {
                        let residual = normal.dot(&off);
                        let weight = (scale * scale / (scale * scale + residual * residual)).powi(2);
                        let row = Vector3::new(normal.x, normal.y, normal.dot(&turned(own - center)) / extent);
                        h += row * row.transpose() * weight;
                        g += row * (weight * residual);
                        all += weight;
                    }
                }
                information = h / f64::max(all, 1.0);
                let Some(step) = (h + Matrix3::identity() * (1e-6 * all.max(1.0))).cholesky().map(|c| c.solve(&-g))
                else {
                    return (pose, Matrix3::zeros());
                };
                // The turn is about the middle.
                let turn = step.z / extent;
                let origin = center + step.xy() - turned_by(pose.theta + turn, middle);
                pose = Pose::new(origin.x, origin.y, pose.theta + turn);
                if step.norm() < 1e-5 {
                    break;
                }
            }
        }
        (pose, information)
    }

    /// How well a place fits: matches count, points in space that was seen to be empty count against it.
    fn score(&self, cloud: &[Vec2], pose: &Pose) -> f64 {
        cloud
            .iter()
            .map(|p| self.raster.at(put(pose, *p)) - if self.contradicted(put(pose, *p)) { 0.5 } else { 0.0 })
            .sum()
    }

    /// Whether a place was seen to be free, far from surfaces.
    fn contradicted(&self, p: Vec2) -> bool {
        let seen = self.evidence.at(&self.lattice, p);
        seen.free && !seen.surface && self.distance(p) > 2.0 * MATCHED
    }

    fn distance(&self, p: Vec2) -> f64 {
        self.tree.nearest_neighbor_with_distance_2(p.into()).map_or(f64::INFINITY, |(_, d2)| d2.sqrt())
    }

    fn check(
        &self,
        cloud: &[Vec2],
        (pose, information): (&Pose, &Matrix3<f64>),
        frame: usize,
    ) -> Result<(), JoinError> {
        let seen: Vec<Vec2> = cloud
            .iter()
            .map(|p| put(pose, *p))
            .filter(|p| self.evidence.at(&self.lattice, *p).any() || self.distance(*p) <= MATCHED)
            .collect();
        let share = seen.len() as f64 / cloud.len().max(1) as f64;
        if seen.len() < LEAST_POINTS || share < LEAST_SEEN {
            return Err(JoinError::Apart { frame, share: 100.0 * share });
        }
        let matched = seen.iter().filter(|p| self.distance(**p) <= MATCHED).count() as f64 / seen.len() as f64;
        if matched < LEAST_MATCHED {
            return Err(JoinError::Mismatch { frame, matched: 100.0 * matched });
        }
        let least = information.symmetric_eigen();
        let (k, held) = least.eigenvalues.argmin();
        if held < LEAST_HELD {
            let loose = least.eigenvectors.column(k);
            let why = match loose.z.abs() > 0.7 {
                true => "nothing holds its turn".into(),
                false => format!("nothing holds it along ({:.2}, {:.2})", loose.x, loose.y),
            };
            return Err(JoinError::Undetermined { frame, why });
        }
        Ok(())
    }
}

fn put(frame: &Pose, p: Vec2) -> Vec2 {
    frame.position() + turned_by(frame.theta, p)
}

fn distinct(a: &Pose, b: &Pose) -> bool {
    (a.position() - b.position()).norm() > DISTINCT[0] || wrap_angle(a.theta - b.theta).abs() > DISTINCT[1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::inverse;
    use crate::scan::Noise;
    use crate::sim::{Survey, misplaced};

    const NOISE: Noise = Noise { sigma_x: 0.03, sigma_y: 0.03, sigma_theta: 0.004, sigma_range: 0.02 };

    fn loose() -> Cov3 {
        Cov3::from_diagonal(&Vector3::new(0.16, 0.16, 0.01))
    }

    /// An office's scans in two halves, the second as seen from a frame that lies at `frame`.
    fn halves(frame: &Pose) -> Vec<LaserScan> {
        let back = inverse(frame);
        let scans = misplaced(&Survey::office(0.02, 5).scans, &NOISE, 5);
        let own = |(k, scan): (usize, LaserScan)| match k % 2 {
            0 => scan,
            _ => LaserScan { frame: 1, ..moved(&scan, &back) },
        };
        scans.into_iter().enumerate().map(own).collect()
    }

    #[test]
    fn a_guess_off_by_decimetres_and_degrees_comes_home() {
        let frame = Pose::new(3.0, -2.0, 0.8);
        let scans = halves(&frame);
        for (dx, dy, turn) in [(0.3, -0.3, 0.09), (-0.5, 0.4, -0.12), (0.0, 0.0, 0.0)] {
            let guess = Guess { pose: Pose::new(3.0 + dx, -2.0 + dy, 0.8 + turn), covariance: loose() };
            let first = Guess { pose: Pose::new(0.0, 0.0, 0.0), covariance: Cov3::zeros() };
            let places = aligned(&scans, &[first, guess], &|| true).unwrap();
            let off = (places[1].position() - frame.position()).norm();
            assert!(off < 0.06 && (places[1].theta - frame.theta).abs() < 0.006, "{off} {:?}", places[1]);
        }
    }

    #[test]
    fn a_wrong_guess_is_refused_and_so_are_maps_that_share_nothing() {
        let frame = Pose::new(3.0, -2.0, 0.8);
        let scans = halves(&frame);
        let first = Guess { pose: Pose::new(0.0, 0.0, 0.0), covariance: Cov3::zeros() };
        for wrong in [Pose::new(5.1, -0.7, 0.8), Pose::new(3.0, -2.0, 2.1), Pose::new(60.0, 0.0, 0.8)] {
            let guess = Guess { pose: wrong, covariance: loose() };
            let refused = aligned(&scans, &[first, guess], &|| true);
            assert!(refused.is_err(), "{wrong:?}: {refused:?}");
        }
    }
}
