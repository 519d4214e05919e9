//! The covariance of a return in the plane, and how it changes with the inputs.
//!
//! ```text
//! pose uncertain:  C = J_pose cov(pose) J_pose^T + sigma_r^2 d d^T + sigma_m^2 I      J_pose = [I | r d_perp]
//! pose known:      C = sigma_r^2 d d^T + sigma_m^2 I
//! ```
//!
//! The first is what one return looks like on its own. The second is for a fit that has the poses among its unknowns:
//! what they do to a whole scan at once is then modelled where it belongs. `sigma_m` stands for what the spline cannot
//! follow; it also keeps a grazing beam, whose range says nothing about where its wall is, from an infinite weight.

use nalgebra::SMatrix;

use super::returns::Return;
use crate::geometry::{Cov2, Cov3, Vec2, turned};

/// How noisy the returns of one scan are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReturnNoise {
    /// The pose's covariance where the pose is uncertain.
    pub pose: Option<Cov3>,
    /// Metres squared.
    pub range_variance: f64,
    /// Metres squared.
    pub model_variance: f64,
}

/// A return's covariance and its derivatives by heading, by range, and twice by heading.
///
/// The last is left out (zero) for an uncertain pose: heading is then an input, and inputs enter once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CovarianceJet {
    pub value: Cov2,
    pub by_heading: Cov2,
    pub by_range: Cov2,
    pub by_heading_twice: Cov2,
}

impl ReturnNoise {
    /// The covariance of a return, square metres.
    pub fn covariance(&self, seen: &Return) -> Cov2 {
        let d = seen.direction;
        let own = d * d.transpose() * self.range_variance + Cov2::identity() * self.model_variance;
        match &self.pose {
            Some(pose) => own + seen.by_pose() * pose * seen.by_pose().transpose(),
            None => own,
        }
    }

    pub fn jet(&self, seen: &Return) -> CovarianceJet {
        let d = seen.direction;
        let across = turned(d);
        let symmetric = |half: Cov2| half + half.transpose();
        let mut jet = CovarianceJet {
            value: self.covariance(seen),
            by_heading: symmetric(across * d.transpose()) * self.range_variance,
            by_range: Cov2::zeros(),
            by_heading_twice: Cov2::zeros(),
        };
        match &self.pose {
            Some(pose) => {
                let along = |column: Vec2| {
                    let mut changed = SMatrix::<f64, 2, 3>::zeros();
                    changed.set_column(2, &column);
                    symmetric(changed * pose * seen.by_pose().transpose())
                };
                jet.by_heading += along(-d * seen.range);
                jet.by_range = along(across);
            }
            None => {
                jet.by_heading_twice = (across * across.transpose() - d * d.transpose()) * (2.0 * self.range_variance);
            }
        }
        jet
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn seen(angle: f64, range: f64) -> Return {
        let direction = Vec2::new(angle.cos(), angle.sin());
        Return { scan: 0, beam: 0, point: direction * range, direction, range }
    }

    proptest! {
        #[test]
        fn derivatives_agree_with_central_differences(
            angle in -4.0..4.0f64, range in 0.1..20.0f64, uncertain in any::<bool>(),
        ) {
            let pose = Cov3::new(4e-4, 1e-4, 2e-5, 1e-4, 3e-4, -1e-5, 2e-5, -1e-5, 9e-5);
            let noise = ReturnNoise { pose: uncertain.then_some(pose), range_variance: 4e-4, model_variance: 1e-5 };
            let (e, jet) = (1e-5, noise.jet(&seen(angle, range)));
            let at = |da: f64, dr: f64| noise.jet(&seen(angle + da, range + dr));
            let by_heading = (at(e, 0.0).value - at(-e, 0.0).value) / (2.0 * e);
            let by_range = (at(0.0, e).value - at(0.0, -e).value) / (2.0 * e);
            prop_assert!((by_heading - jet.by_heading).norm() < 1e-7);
            prop_assert!((by_range - jet.by_range).norm() < 1e-7);
            if !uncertain {
                let twice = (at(e, 0.0).by_heading - at(-e, 0.0).by_heading) / (2.0 * e);
                prop_assert!((twice - jet.by_heading_twice).norm() < 1e-7);
            }
        }
    }
}
