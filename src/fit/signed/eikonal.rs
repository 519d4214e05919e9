//! The Eikonal loss `weight * rho(|g|^2 - 1)` of a gradient `g`: a distance function has unit slope.
//!
//! `rho(r) = r^2`, or with a scale `s` Geman-McClure's `r^2 / (1 + r^2/s^2)`. At the cut locus no spline can have unit
//! gradient; a squared loss lets those residuals bend everything along the characteristics that end there.

use super::loss::{Curvature, LocalJet};
use crate::geometry::{Cov2, Vec2};

/// See the module. `weight` counts per cell, of which a quadrature point has its share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EikonalLoss {
    pub weight: f64,
    pub scale: Option<f64>,
}

impl EikonalLoss {
    /// `rho` and its first two derivatives at the residual `r = |g|^2 - 1`.
    fn rho(&self, r: f64) -> (f64, f64, f64) {
        match self.scale {
            None => (r * r, 2.0 * r, 2.0),
            Some(s) => {
                let (s2, r2) = (s * s, r * r);
                let d = s2 + r2;
                (s2 * r2 / d, 2.0 * r * s2 * s2 / (d * d), 2.0 * s2 * s2 * (s2 - 3.0 * r2) / (d * d * d))
            }
        }
    }

    pub fn value(&self, share: f64, g: Vec2) -> f64 {
        share * self.weight * self.rho(g.norm_squared() - 1.0).0
    }

    /// The loss's gradient by `g`.
    pub fn slope(&self, share: f64, g: Vec2) -> Vec2 {
        g * (share * self.weight * 2.0 * self.rho(g.norm_squared() - 1.0).1)
    }

    /// In gradient space the Hessian is `2 rho' I + 4 rho'' g g^T`: eigenvalues `2 rho' + 4 q rho''` along `g` and
    /// `2 rho'` across (`12q - 4` and `4(q - 1)` for the squared loss, `q = |g|^2`), which the convex stand-in clamps
    /// at zero.
    pub fn jet(&self, share: f64, g: Vec2, curvature: Curvature) -> LocalJet<2> {
        let (q, weight) = (g.norm_squared(), share * self.weight);
        let (value, first, second) = self.rho(q - 1.0);
        let (across, along) = (curvature.of(2.0 * first), curvature.of(2.0 * first + 4.0 * q * second));
        let outer = if q > 0.0 { g * g.transpose() / q } else { Cov2::zeros() };
        let hessian = Cov2::identity() * across + outer * (along - across);
        LocalJet { value: weight * value, gradient: g * (weight * 2.0 * first), hessian: hessian * weight }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn derivatives_agree_with_central_differences(x in -1.5..1.5f64, y in -1.5..1.5f64, robust in any::<bool>()) {
            let loss = EikonalLoss { weight: 3.0, scale: robust.then_some(0.2) };
            let (g, e) = (Vec2::new(x, y), 1e-6);
            let jet = loss.jet(1.0, g, Curvature::EXACT);
            for axis in 0..2 {
                let mut d = Vec2::zeros();
                d[axis] = e;
                let (ahead, behind) = (loss.jet(1.0, g + d, Curvature::EXACT), loss.jet(1.0, g - d, Curvature::EXACT));
                prop_assert!(((ahead.value - behind.value) / (2.0 * e) - jet.gradient[axis]).abs() < 1e-5);
                let column = (ahead.gradient - behind.gradient) / (2.0 * e);
                prop_assert!((column - jet.hessian.column(axis)).norm() < 1e-4 * (1.0 + jet.hessian.norm()));
            }
            prop_assert!(loss.jet(1.0, g, Curvature::CONVEX).hessian.symmetric_eigenvalues().min() >= -1e-9);
        }
    }
}
