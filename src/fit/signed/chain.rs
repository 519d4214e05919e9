//! The chain rule from a sighting's local quantities to what they depend on: control points, pose and range.
//!
//! With `D = [B, B_x, B_y]` the basis rows at the return (so `(u, g) = D^T c`), `X` its place and `phi` the loss,
//!
//! ```text
//! d2f/dc dc = D phi'' D^T
//! d2f/dc da = D phi'' xi_a + sum_i phi'_i grad(D_i) . X_a
//! d2f/da db = xi_a^T phi'' xi_b + sum_i phi'_i (X_a^T Hess(D_i^T c) X_b + grad(D_i^T c) . X_ab)
//! ```
//!
//! for `a, b` in (x, y, theta, r) and `xi_a` the local quantities' derivative by `a`. The Gauss-Newton stand-in keeps
//! the terms with `phi''` alone.

use nalgebra::{Matrix4, SVector, Vector4};

use super::loss::{Curvature, LocalJet};
use crate::geometry::{Cov2, Vec2, turned};
use crate::scan::Return;
use crate::sparse::CellBlock;
use crate::spline::{BasisRow, Jet, SUPPORT};

/// The derivatives of one sighting's loss by its pose and range, and mixed with its cell's control points.
pub struct InputJet {
    /// By (x, y, theta, r).
    pub gradient: Vector4<f64>,
    /// Second derivatives among (x, y, theta, r).
    pub second: Matrix4<f64>,
    /// Mixed with the 16 control points: `mixed[a][k]`.
    pub mixed: [[f64; SUPPORT]; 4],
}

/// The gradient by the 16 control points; the Hessian is added to `block`.
#[inline]
pub fn by_control_points(row: &BasisRow, jet: &LocalJet<5>, block: &mut CellBlock) -> [f64; SUPPORT] {
    let rows = [&row.value, &row.dx, &row.dy];
    let combine = |w: [f64; 3]| -> [f64; SUPPORT] {
        std::array::from_fn(|k| w[0] * row.value[k] + w[1] * row.dx[k] + w[2] * row.dy[k])
    };
    let h = &jet.hessian;
    let images: [[f64; SUPPORT]; 3] = std::array::from_fn(|i| combine([h[(i, 0)], h[(i, 1)], h[(i, 2)]]));
    block.add_products(rows, &images);
    combine([jet.gradient[0], jet.gradient[1], jet.gradient[2]])
}

/// The derivatives by pose and range. `surface` is the distance's jet at the return, `third` its third derivatives.
pub fn by_inputs(
    row: &BasisRow,
    jet: &LocalJet<5>,
    surface: &Jet,
    third: &[f64; 4],
    seen: &Return,
    curvature: Curvature,
) -> InputJet {
    let d = seen.direction;
    let moves = [Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0), turned(d) * seen.range, d];
    let xi: [SVector<f64, 5>; 4] = std::array::from_fn(|a| {
        let bent = surface.hessian * moves[a];
        let direct = |index: usize| f64::from(a == index);
        SVector::<f64, 5>::new(surface.gradient.dot(&moves[a]), bent.x, bent.y, direct(2), direct(3))
    });
    let (f_u, f_g) = (jet.gradient[0], Vec2::new(jet.gradient[1], jet.gradient[2]));
    let exact = curvature.exact_share();
    let mixed = std::array::from_fn(|a| {
        let (phi, m) = (jet.hessian * xi[a], moves[a]);
        std::array::from_fn(|k| {
            let direct = phi[0] * row.value[k] + phi[1] * row.dx[k] + phi[2] * row.dy[k];
            let moved = f_u * (row.dx[k] * m.x + row.dy[k] * m.y)
                + f_g.x * (row.dxx[k] * m.x + row.dxy[k] * m.y)
                + f_g.y * (row.dxy[k] * m.x + row.dyy[k] * m.y);
            direct + exact * moved
        })
    });
    // The Hessian of u, g_x and g_y by place, weighed by the loss's gradient.
    let [xxx, xxy, xyy, yyy] = *third;
    let bend = surface.hessian * f_u + Cov2::new(xxx, xxy, xxy, xyy) * f_g.x + Cov2::new(xxy, xyy, xyy, yyy) * f_g.y;
    let pull = surface.gradient * f_u + surface.hessian * f_g;
    let second = Matrix4::from_fn(|a, b| {
        let direct = xi[a].dot(&(jet.hessian * xi[b]));
        let curve = match (a.min(b), a.max(b)) {
            (2, 2) => -d * seen.range,
            (2, 3) => turned(d),
            _ => Vec2::zeros(),
        };
        direct + exact * (moves[a].dot(&(bend * moves[b])) + pull.dot(&curve))
    });
    InputJet { gradient: Vector4::from_fn(|a, _| jet.gradient.dot(&xi[a])), second, mixed }
}
