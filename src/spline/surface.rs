//! A spline surface: a lattice and its coefficients.

use super::basis::{SUPPORT, cubic, dot};
use super::lattice::{Lattice, Located};
use crate::geometry::{Cov2, Vec2};

/// A surface's value and derivatives at one point: metres, 1, 1/metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet {
    pub value: f64,
    pub gradient: Vec2,
    pub hessian: Cov2,
}

/// A surface's third derivatives at one point, 1/metres^2: by x x x, x x y, x y y and y y y.
///
/// They are constant in x (or y) within a cell where they are of third order in it, and jump between cells.
pub fn third_derivatives(lattice: &Lattice, at: &Located, local: &[f64; SUPPORT]) -> [f64; 4] {
    let h3 = lattice.resolution.powi(3);
    std::array::from_fn(|k| {
        let (x, y) = (cubic(at.local[0], 3 - k as u8), cubic(at.local[1], k as u8));
        (0..SUPPORT).map(|n| x[n % 4] * y[n / 4] * local[n]).sum::<f64>() / h3
    })
}

/// A cubic B-spline surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    pub lattice: Lattice,
    /// One coefficient a control point, x fastest, metres.
    pub coefficients: Vec<f64>,
}

impl Surface {
    /// The coefficients of a cell's 16 control points.
    #[inline]
    pub fn gather(&self, cell: [usize; 2]) -> [f64; SUPPORT] {
        gather(&self.coefficients, &self.lattice.support(cell))
    }

    /// The surface's value, or `None` outside the lattice.
    pub fn value(&self, p: Vec2) -> Option<f64> {
        self.lattice.locate(p).map(|at| self.value_at(&at))
    }

    /// The value alone, at a point already located.
    pub fn value_at(&self, at: &Located) -> f64 {
        dot(&self.lattice.value_row(at), &self.gather(at.cell))
    }

    /// Value, gradient and second derivatives, or `None` outside the lattice.
    pub fn jet(&self, p: Vec2) -> Option<Jet> {
        self.lattice.locate(p).map(|at| self.jet_at(&at))
    }

    /// [`Surface::jet`] at a point already located.
    pub fn jet_at(&self, at: &Located) -> Jet {
        let (row, c) = (self.lattice.row(at), self.gather(at.cell));
        let xy = dot(&row.dxy, &c);
        Jet {
            value: dot(&row.value, &c),
            gradient: Vec2::new(dot(&row.dx, &c), dot(&row.dy, &c)),
            hessian: Cov2::new(dot(&row.dxx, &c), xy, xy, dot(&row.dyy, &c)),
        }
    }
}

/// The entries of `values` at the 16 control points of a cell.
#[inline]
pub(crate) fn gather(values: &[f64], support: &[usize; SUPPORT]) -> [f64; SUPPORT] {
    std::array::from_fn(|k| values[support[k]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Bounds;
    use proptest::prelude::*;

    fn wavy() -> Surface {
        let bounds = Bounds { min: [-1.0, 0.0], max: [1.0, 2.0] };
        let lattice = Lattice::covering(&bounds, 0.4, 1_000).unwrap();
        let coefficients = (0..lattice.len()).map(|k| ((k * k) as f64 * 0.37).sin()).collect();
        Surface { lattice, coefficients }
    }

    proptest! {
        #[test]
        fn derivatives_agree_with_central_differences(x in -0.9..0.9f64, y in 0.1..1.9f64) {
            let (surface, e) = (wavy(), 1e-5);
            let jet = surface.jet(Vec2::new(x, y)).unwrap();
            let at_point = surface.lattice.locate(Vec2::new(x, y)).unwrap();
            // Second derivatives have a kink at a knot, so a difference across one says nothing.
            let knots = 2.0 * e / surface.lattice.resolution;
            prop_assume!(at_point.local.iter().all(|t| (knots..1.0 - knots).contains(t)));
            prop_assert_eq!(surface.value_at(&at_point), jet.value);
            let at = |dx: f64, dy: f64| surface.jet(Vec2::new(x + dx, y + dy)).unwrap();
            let gx = (at(e, 0.0).value - at(-e, 0.0).value) / (2.0 * e);
            let gy = (at(0.0, e).value - at(0.0, -e).value) / (2.0 * e);
            prop_assert!((gx - jet.gradient.x).abs() < 1e-7 && (gy - jet.gradient.y).abs() < 1e-7);
            let hx = (at(e, 0.0).gradient - at(-e, 0.0).gradient) / (2.0 * e);
            let hy = (at(0.0, e).gradient - at(0.0, -e).gradient) / (2.0 * e);
            prop_assert!((hx - jet.hessian.column(0)).norm() < 1e-4);
            prop_assert!((hy - jet.hessian.column(1)).norm() < 1e-4);
            let nudged = |t: f64| {
                let local = [at_point.local[0] + t, at_point.local[1]];
                surface.jet_at(&Located { cell: at_point.cell, local }).hessian
            };
            let slope = (nudged(1e-4) - nudged(-1e-4)) / (2e-4 * surface.lattice.resolution);
            let third = third_derivatives(&surface.lattice, &at_point, &surface.gather(at_point.cell));
            prop_assert!((slope[(0, 0)] - third[0]).abs() < 1e-6);
            prop_assert!((slope[(0, 1)] - third[1]).abs() < 1e-6);
            prop_assert!((slope[(1, 1)] - third[2]).abs() < 1e-6);
        }
    }

    #[test]
    fn a_lattice_of_ones_is_the_constant_one() {
        let mut surface = wavy();
        surface.coefficients.fill(1.0);
        assert!((surface.value(Vec2::new(0.123, 1.4)).unwrap() - 1.0).abs() < 1e-15);
    }
}
