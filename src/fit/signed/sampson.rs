//! What a return says about the surface: `u^2 / (g^T C g)`, Sampson's distance, or the published `rho_o u^2`.
//!
//! `u` and `g` are the distance and its gradient at the return, `C` the return's covariance: the loss is the squared
//! distance to the zero level in standard deviations. Scaling `u` does not change it, so returns that scatter about a
//! wall cannot flatten the map, which a weight frozen at the start lets them do (errors in variables: attenuation).
//!
//! Local quantities are `(u, g_x, g_y, theta, r)`: through `C` the loss depends on heading and range directly, too.

use nalgebra::{SMatrix, SVector};

use super::loss::{Curvature, LocalJet};
use crate::geometry::Vec2;
use crate::scan::CovarianceJet;

/// A share of `tr C` added to `g^T C g`, so that a vanishing gradient is not an infinite weight.
const GRADIENT_FLOOR: f64 = 1e-4;

/// Sampson's loss at distance `u` and gradient `g`, in `(u, g_x, g_y, theta, r)`.
pub fn sampson(u: f64, g: Vec2, c: &CovarianceJet, curvature: Curvature) -> LocalJet<5> {
    let v = g.dot(&(c.value * g)) + GRADIENT_FLOOR * c.value.trace();
    let along = |dc: &crate::geometry::Cov2| g.dot(&(dc * g)) + GRADIENT_FLOOR * dc.trace();
    let slope = c.value * g * 2.0;
    // v's derivatives by (g_x, g_y, theta, r), preceded by a zero for u.
    let dv = SVector::<f64, 5>::new(0.0, slope.x, slope.y, along(&c.by_heading), along(&c.by_range));
    let w = u / v;
    let unit = SVector::<f64, 5>::new(1.0, 0.0, 0.0, 0.0, 0.0);
    let gradient = unit * (2.0 * w) - dv * (w * w);
    // The residual u / sqrt(v) has the gradient (unit - w dv / 2) / sqrt(v).
    let residual = unit - dv * (0.5 * w);
    let mut hessian = residual * residual.transpose() * (2.0 / v);
    let exact = curvature.exact_share();
    if exact > 0.0 {
        // What Gauss-Newton's leaves out: the residual times its second derivative, doubled.
        let cross = unit * dv.transpose();
        let left_out = dv * dv.transpose() * (1.5 * w * w / v)
            - (cross + cross.transpose()) * (w / v)
            - second_of_variance(g, c, along(&c.by_heading_twice)) * (w * w);
        hessian += left_out * exact;
    }
    LocalJet { value: u * w, gradient, hessian }
}

fn second_of_variance(g: Vec2, c: &CovarianceJet, by_heading_twice: f64) -> SMatrix<f64, 5, 5> {
    let mut second = SMatrix::<f64, 5, 5>::zeros();
    second.fixed_view_mut::<2, 2>(1, 1).copy_from(&(c.value * 2.0));
    for (k, change) in [(3, c.by_heading * g * 2.0), (4, c.by_range * g * 2.0)] {
        for axis in 0..2 {
            second[(1 + axis, k)] = change[axis];
            second[(k, 1 + axis)] = change[axis];
        }
    }
    second[(3, 3)] = by_heading_twice;
    second
}

/// The published loss `weight u^2`, its weight a constant.
pub fn frozen(u: f64, weight: f64) -> LocalJet<5> {
    let mut jet =
        LocalJet { value: weight * u * u, gradient: SVector::zeros(), hessian: SMatrix::<f64, 5, 5>::zeros() };
    jet.gradient[0] = 2.0 * weight * u;
    jet.hessian[(0, 0)] = 2.0 * weight;
    jet
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec2;
    use crate::scan::{Return, ReturnNoise};
    use proptest::prelude::*;

    fn jet_at(q: &SVector<f64, 5>) -> LocalJet<5> {
        let direction = Vec2::new(q[3].cos(), q[3].sin());
        let seen = Return { scan: 0, beam: 0, point: direction * q[4], direction, range: q[4] };
        let noise = ReturnNoise { pose: None, range_variance: 4e-4, model_variance: 1e-4 };
        sampson(q[0], Vec2::new(q[1], q[2]), &noise.jet(&seen), Curvature::EXACT)
    }

    proptest! {
        #[test]
        fn derivatives_agree_with_central_differences(
            u in -0.1..0.1f64, x in 0.3..1.2f64, y in -1.0..1.0f64, theta in -3.0..3.0f64,
        ) {
            let (at, e) = (SVector::<f64, 5>::new(u, x, y, theta, 3.0), 1e-6);
            let jet = jet_at(&at);
            for k in 0..5 {
                let mut d = SVector::<f64, 5>::zeros();
                d[k] = e;
                let (ahead, behind) = (jet_at(&(at + d)), jet_at(&(at - d)));
                let slope = (ahead.value - behind.value) / (2.0 * e);
                prop_assert!((slope - jet.gradient[k]).abs() < 1e-5 * (1.0 + jet.gradient.norm()));
                let column = (ahead.gradient - behind.gradient) / (2.0 * e);
                prop_assert!((column - jet.hessian.column(k)).norm() < 1e-5 * (1.0 + jet.hessian.norm()));
            }
        }
    }
}
