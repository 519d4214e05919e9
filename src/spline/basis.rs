//! The uniform cubic B-spline basis and its tensor product over one cell.
//!
//! On `[0, 1]` the four basis functions that do not vanish are
//! `(1-t)^3/6, (3t^3-6t^2+4)/6, (-3t^3+3t^2+3t+1)/6, t^3/6`; they sum to one.

/// Control points with influence on one cell: 4 x 4.
pub const SUPPORT: usize = 16;

/// The four basis functions at `t`, or their derivative of the given order with respect to `t`.
pub fn cubic(t: f64, order: u8) -> [f64; 4] {
    let s = 1.0 - t;
    match order {
        0 => [
            s * s * s / 6.0,
            (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
            (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
            t * t * t / 6.0,
        ],
        1 => [-s * s / 2.0, (3.0 * t * t - 4.0 * t) / 2.0, (-3.0 * t * t + 2.0 * t + 1.0) / 2.0, t * t / 2.0],
        2 => [s, 3.0 * t - 2.0, 1.0 - 3.0 * t, t],
        3 => [-1.0, 3.0, -3.0, 1.0],
        _ => [0.0; 4],
    }
}

/// What a surface's value and derivatives at one point are in terms of its cell's 16 control points.
///
/// Entry `a + 4 b` belongs to control point `(i + a, j + b)` of cell `(i, j)`. Derivatives are per metre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BasisRow {
    pub value: [f64; SUPPORT],
    pub dx: [f64; SUPPORT],
    pub dy: [f64; SUPPORT],
    pub dxx: [f64; SUPPORT],
    pub dxy: [f64; SUPPORT],
    pub dyy: [f64; SUPPORT],
}

impl BasisRow {
    /// The row at local coordinates `(t, w)` of a cell with side `h`.
    pub fn at(t: f64, w: f64, h: f64) -> Self {
        let (x0, x1, x2) = (cubic(t, 0), cubic(t, 1), cubic(t, 2));
        let (y0, y1, y2) = (cubic(w, 0), cubic(w, 1), cubic(w, 2));
        Self {
            value: product(&x0, &y0, 1.0),
            dx: product(&x1, &y0, 1.0 / h),
            dy: product(&x0, &y1, 1.0 / h),
            dxx: product(&x2, &y0, 1.0 / (h * h)),
            dxy: product(&x1, &y1, 1.0 / (h * h)),
            dyy: product(&x0, &y2, 1.0 / (h * h)),
        }
    }
}

/// What a row is of its two axes' functions.
#[inline]
pub(super) fn product(x: &[f64; 4], y: &[f64; 4], scale: f64) -> [f64; SUPPORT] {
    std::array::from_fn(|k| scale * x[k % 4] * y[k / 4])
}

/// The inner product over a cell's 16 control points.
#[inline]
pub(crate) fn dot(row: &[f64; SUPPORT], c: &[f64; SUPPORT]) -> f64 {
    row.iter().zip(c).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn basis_is_a_partition_of_unity(t in 0.0..=1.0f64) {
            prop_assert!((cubic(t, 0).iter().sum::<f64>() - 1.0).abs() < 1e-15);
            prop_assert!(cubic(t, 1).iter().sum::<f64>().abs() < 1e-15);
            prop_assert!(cubic(t, 2).iter().sum::<f64>().abs() < 1e-14);
        }

        #[test]
        fn derivatives_agree_with_central_differences(t in 0.01..=0.99f64) {
            let e = 1e-5;
            for order in 0..3u8 {
                for k in 0..4 {
                    let slope = (cubic(t + e, order)[k] - cubic(t - e, order)[k]) / (2.0 * e);
                    prop_assert!((slope - cubic(t, order + 1)[k]).abs() < 1e-9);
                }
            }
        }
    }
}
