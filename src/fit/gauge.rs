//! The rigid motion that no scan can tell: of the map and all poses together.
//!
//! Moving everything at once changes no distance between anything seen, so the data say nothing about three of the pose
//! unknowns' directions; their prior alone does. On a lattice that is not quite so: how well a spline follows a corner
//! depends on where the corner lies in its cell, and the fit would move the map by centimetres, against a weak prior,
//! to where corners suit the lattice, and report that place with a confidence nobody has. So the common motion is not
//! fitted. In the unknowns `e` of `q = q0 + R e` it spans
//!
//! ```text
//! U = orthonormal basis of [R_k^-1 A_k]_k      A_k = [1 0 -(y_k - y_c); 0 1 x_k - x_c; 0 0 1]
//! ```
//!
//! and the objective gains `kappa |U^T e|^2`, a stiff spring: the fit keeps the reported poses' weighted mean motion,
//! which is what the prior alone would say. The inputs' noise moves that mean, and so the map; *propagated* sees it
//! through the inputs, and *posterior* adds the prior's variance along `U`.
//!
//! Where some pose is exactly known in some direction (a singular covariance) the frame is tied down, and there is no
//! gauge.
//!
//! Maps that are joined have a frame each, in which their scans' poses were reported, and where it lies is unknown: the
//! common motion of a frame's scans costs nothing. With a frame's place `f` an unknown without a prior, minimised out,
//!
//! ```text
//! min over f of sum_k |e_k - R_k^-1 A_k f|^2 = |e|^2 - |U_f^T e|^2      U_f as U, of the frame's scans alone
//! ```
//!
//! which is one more spring, of the stiffness -1 (a millionth less, so that what nothing holds is loose but finite). The
//! first frame is the joined map's, and the gauge is its scans': they keep their mean motion. `f = S U_f^T e` with the `S` of
//! [`FrameMotion`].

use faer::Mat;
use nalgebra::{DMatrix, Matrix3};

use super::viewpoint::Viewpoint;
use crate::geometry::Vec2;

/// Stiff beside the information that scans hold about their poses, in units of the prior's; soft beside rounding.
pub(super) const STIFFNESS: f64 = 1e6;
/// How much of the prior's hold on a frame's common motion is taken away.
pub(crate) const LOOSE: f64 = 1.0 - 1e-6;

/// A root whose determinant is below this share of its norm's cube is singular.
const SINGULAR: f64 = 1e-12;

/// The common motions and how stiff they are.
#[derive(Debug, Clone)]
pub struct Motions {
    /// Orthonormal, pose unknowns x motions: the gauge's, then every further frame's.
    pub columns: Mat<f64>,
    /// The gauge's: 3, or 0 where the frame is tied down.
    pub held: usize,
    pub frames: Vec<FrameMotion>,
}

/// The common motion of the scans of a frame that is not the first.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMotion {
    pub frame: usize,
    /// Its first of three columns.
    pub first: usize,
    /// What it turns about.
    pub center: Vec2,
    /// `S`: (x, y, theta) of the columns' amplitudes.
    pub scale: Matrix3<f64>,
}

impl Motions {
    /// None at all, of so many pose unknowns.
    pub fn none(unknowns: usize) -> Self {
        Self { columns: Mat::zeros(unknowns, 0), held: 0, frames: Vec::new() }
    }

    /// Those of the scans' frames. A frame with an exactly known coordinate is tied down.
    pub fn of(viewpoints: &[Viewpoint]) -> Self {
        let last = viewpoints.iter().map(|own| own.frame).max().unwrap_or(0);
        let mut own = Self::none(3 * viewpoints.len());
        for frame in 0..=last {
            let Some((columns, center, scale)) = common_motion(viewpoints, frame) else { continue };
            let first = own.columns.ncols();
            own.columns =
                Mat::from_fn(3 * viewpoints.len(), first + 3, |row, column| match column.checked_sub(first) {
                    Some(new) => columns[(row, new)],
                    None => own.columns[(row, column)],
                });
            match frame {
                0 => own.held = 3,
                _ => own.frames.push(FrameMotion { frame, first, center, scale }),
            }
        }
        own
    }

    pub fn ncols(&self) -> usize {
        self.columns.ncols()
    }

    /// A motion's stiffness in units of the prior's.
    pub fn stiffness(&self, column: usize) -> f64 {
        if column < self.held { STIFFNESS } else { -LOOSE }
    }

    /// How far unknowns go along the motions.
    pub fn along(&self, e: &[f64]) -> Vec<f64> {
        (0..self.ncols()).map(|k| e.iter().enumerate().map(|(row, e)| self.columns[(row, k)] * e).sum()).collect()
    }

    /// What the springs cost: `sum of s (u^T e)^2`.
    pub fn energy(&self, e: &[f64]) -> f64 {
        self.along(e).iter().enumerate().map(|(k, v)| self.stiffness(k) * v * v).sum()
    }

    /// Adds the springs' gradient, `sum of 2 s u u^T e`, which is their Hessian's product with `e`, too.
    pub fn add_pull(&self, e: &[f64], into: &mut [f64]) {
        for (k, along) in self.along(e).into_iter().enumerate() {
            let pull = 2.0 * self.stiffness(k) * along;
            into.iter_mut().enumerate().for_each(|(row, into)| *into += pull * self.columns[(row, k)]);
        }
    }

    /// The springs' Hessian, `sum of 2 s u u^T`.
    pub fn spring(&self) -> Mat<f64> {
        let weighed =
            Mat::from_fn(self.columns.nrows(), self.ncols(), |row, k| 2.0 * self.stiffness(k) * self.columns[(row, k)]);
        weighed * self.columns.transpose()
    }
}

/// `U` of a frame's scans, what it turns about, and `S`; `None` where a coordinate of one is exactly known.
fn common_motion(viewpoints: &[Viewpoint], frame: usize) -> Option<(DMatrix<f64>, Vec2, Matrix3<f64>)> {
    let own = || viewpoints.iter().enumerate().filter(|(_, own)| own.frame == frame);
    let center = own().map(|(_, own)| own.position).sum::<Vec2>() / own().count().max(1) as f64;
    let mut motion = DMatrix::<f64>::zeros(3 * viewpoints.len(), 3);
    for (scan, viewpoint) in own() {
        let root = &viewpoint.root;
        let inverse = root.try_inverse().filter(|_| root.determinant().abs() > SINGULAR * root.norm().powi(3))?;
        let arm = viewpoint.position - center;
        let rigid = Matrix3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x, 0.0, 0.0, 1.0);
        motion.fixed_rows_mut::<3>(3 * scan).copy_from(&(inverse * rigid));
    }
    let split = motion.qr();
    let scale = Matrix3::from_fn(|a, b| split.r()[(a, b)]).try_inverse()?;
    Some((split.q(), center, scale))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Cov3;
    use crate::scan::ReturnNoise;

    fn viewpoint(x: f64, y: f64, root: Cov3) -> Viewpoint {
        let noise = ReturnNoise { pose: None, range_variance: 1e-4, model_variance: 0.0 };
        Viewpoint { position: Vec2::new(x, y), root, frame: 0, noise }
    }

    #[test]
    fn a_common_turn_lies_in_the_gauge_and_a_parting_does_not() {
        let root = Cov3::from_diagonal(&nalgebra::Vector3::new(0.1, 0.1, 0.05));
        let gauge = Motions::of(&[viewpoint(0.0, 0.0, root), viewpoint(4.0, 2.0, root)]);
        // A turn by 0.01 about the middle, (2, 1).
        let turn = [0.01 / 0.1, -0.02 / 0.1, 0.01 / 0.05, -0.01 / 0.1, 0.02 / 0.1, 0.01 / 0.05];
        let held = gauge.along(&turn).iter().map(|v| v * v).sum::<f64>();
        assert!((held - turn.iter().map(|v| v * v).sum::<f64>()).abs() < 1e-12);
        let parting = [-2.0, -1.0, 0.0, 2.0, 1.0, 0.0];
        assert!(gauge.along(&parting).iter().map(|v| v * v).sum::<f64>() < 1e-12);
    }

    #[test]
    fn an_exactly_known_heading_ties_the_frame_down() {
        let known = Cov3::from_diagonal(&nalgebra::Vector3::new(0.1, 0.1, 0.0));
        assert_eq!(Motions::of(&[viewpoint(0.0, 0.0, known)]).ncols(), 0);
    }

    #[test]
    fn a_frames_common_motion_costs_next_to_nothing_and_is_told() {
        let root = Cov3::from_diagonal(&nalgebra::Vector3::new(0.1, 0.2, 0.05));
        let joined = |x, y| Viewpoint { frame: 1, ..viewpoint(x, y, root) };
        let views = [viewpoint(0.0, 0.0, root), joined(1.0, 5.0), joined(4.0, 2.0), joined(2.0, 2.0)];
        let motions = Motions::of(&views);
        assert_eq!((motions.ncols(), motions.held, motions.frames.len()), (6, 3, 1));
        let frame = &motions.frames[0];
        let f = nalgebra::Vector3::new(0.03, -0.02, 0.01);
        let mut e = vec![0.0; 3];
        for own in &views[1..] {
            let arm = own.position - frame.center;
            let moved = nalgebra::Vector3::new(f.x - arm.y * f.z, f.y + arm.x * f.z, f.z);
            e.extend((root.try_inverse().unwrap() * moved).iter());
        }
        let along = motions.along(&e);
        let told = frame.scale * nalgebra::Vector3::new(along[3], along[4], along[5]);
        assert!((told - f).norm() < 1e-12);
        let prior: f64 = e.iter().map(|e| e * e).sum();
        assert!((prior + motions.energy(&e)).abs() < 1e-5 * prior);
    }
}
