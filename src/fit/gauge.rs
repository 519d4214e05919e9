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

use faer::Mat;
use nalgebra::{DMatrix, Matrix3};

use super::viewpoint::Viewpoint;

/// Stiff beside the information that scans hold about their poses, in units of the prior's; soft beside rounding.
pub(crate) const STIFFNESS: f64 = 1e6;

/// A root whose determinant is below this share of its norm's cube is singular.
const SINGULAR: f64 = 1e-12;

/// `U`: pose unknowns x 3, or x 0 where the frame is tied down.
pub fn common_motion(viewpoints: &[Viewpoint]) -> Mat<f64> {
    let none = Mat::zeros(3 * viewpoints.len(), 0);
    let center = viewpoints.iter().map(|v| v.position).sum::<crate::geometry::Vec2>() / viewpoints.len().max(1) as f64;
    let mut motion = DMatrix::<f64>::zeros(3 * viewpoints.len(), 3);
    for (scan, viewpoint) in viewpoints.iter().enumerate() {
        let root = &viewpoint.root;
        let Some(inverse) = root.try_inverse().filter(|_| root.determinant().abs() > SINGULAR * root.norm().powi(3))
        else {
            return none;
        };
        let arm = viewpoint.position - center;
        let rigid = Matrix3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x, 0.0, 0.0, 1.0);
        motion.fixed_rows_mut::<3>(3 * scan).copy_from(&(inverse * rigid));
    }
    let basis = motion.qr().q();
    Mat::from_fn(basis.nrows(), basis.ncols(), |row, column| basis[(row, column)])
}

/// `U^T e`.
fn along(gauge: &Mat<f64>, e: &[f64]) -> Vec<f64> {
    (0..gauge.ncols()).map(|k| e.iter().enumerate().map(|(row, e)| gauge[(row, k)] * e).sum()).collect()
}

/// What the spring costs: `kappa |U^T e|^2`.
pub fn energy(gauge: &Mat<f64>, e: &[f64]) -> f64 {
    STIFFNESS * along(gauge, e).iter().map(|v| v * v).sum::<f64>()
}

/// Adds the spring's gradient, `2 kappa U U^T e`, which is its Hessian's product with `e`, too.
pub fn add_pull(gauge: &Mat<f64>, e: &[f64], into: &mut [f64]) {
    for (k, held) in along(gauge, e).into_iter().enumerate() {
        into.iter_mut().enumerate().for_each(|(row, into)| *into += 2.0 * STIFFNESS * held * gauge[(row, k)]);
    }
}

/// The spring's Hessian, `2 kappa U U^T`; zero where there is no gauge.
pub fn spring(gauge: &Mat<f64>) -> Mat<f64> {
    (gauge * gauge.transpose()) * faer::Scale(2.0 * STIFFNESS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Cov3, Vec2};
    use crate::scan::ReturnNoise;

    fn viewpoint(x: f64, y: f64, root: Cov3) -> Viewpoint {
        let noise = ReturnNoise { pose: None, range_variance: 1e-4, model_variance: 0.0 };
        Viewpoint { position: Vec2::new(x, y), root, noise }
    }

    #[test]
    fn a_common_turn_lies_in_the_gauge_and_a_parting_does_not() {
        let root = Cov3::from_diagonal(&nalgebra::Vector3::new(0.1, 0.1, 0.05));
        let gauge = common_motion(&[viewpoint(0.0, 0.0, root), viewpoint(4.0, 2.0, root)]);
        // A turn by 0.01 about the middle, (2, 1).
        let turn = [0.01 / 0.1, -0.02 / 0.1, 0.01 / 0.05, -0.01 / 0.1, 0.02 / 0.1, 0.01 / 0.05];
        let held = along(&gauge, &turn).iter().map(|v| v * v).sum::<f64>();
        assert!((held - turn.iter().map(|v| v * v).sum::<f64>()).abs() < 1e-12);
        let parting = [-2.0, -1.0, 0.0, 2.0, 1.0, 0.0];
        assert!(along(&gauge, &parting).iter().map(|v| v * v).sum::<f64>() < 1e-12);
    }

    #[test]
    fn an_exactly_known_heading_ties_the_frame_down() {
        let known = Cov3::from_diagonal(&nalgebra::Vector3::new(0.1, 0.1, 0.0));
        assert_eq!(common_motion(&[viewpoint(0.0, 0.0, known)]).ncols(), 0);
    }
}
