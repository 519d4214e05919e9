//! What the pin and the gauge add to selected entries of both covariances: products of a few columns.
//!
//! `Mp^-1` and `S = Mp^-1 G Mp^-1` are the pinned matrix's; `M^-1 = Mp^-1 - V K V^T` (see [`Factor`]), so
//!
//! ```text
//! M^-1 G M^-1 = S - V K Y^T - Y K V^T + V K (V^T G V) K V^T,   Y = Mp^-1 G V
//! ```
//!
//! and both covariances' other terms are columns, too (see `marginals`). All are as long as the unknowns, and few: six, and three more for
//! every joined frame, so any entry costs a few multiplications.

use faer::Mat;

use super::{Kind, UncertaintyError};
use crate::fit::gauge::LOOSE;
use crate::fit::{Estimate, Factor};
use crate::sparse::{Symmetric, SystemMatrix};

/// `scale (A B^T + B A^T) / 2`, rows by unknowns.
pub(super) struct Product {
    left: Mat<f64>,
    right: Mat<f64>,
    scale: f64,
}

/// The products to add to `2 Mp^-1` and to `S`.
pub(super) struct Modes {
    propagated: Vec<Product>,
    posterior: Vec<Product>,
}

impl Modes {
    /// The factor must be that of the estimate's system, and lie in its `cholesky`.
    pub fn of(estimate: &Estimate, factor: &Factor, g: &SystemMatrix) -> Result<Self, UncertaintyError> {
        let v = &factor.images;
        if v.ncols() == 0 {
            return Ok(Self { propagated: Vec::new(), posterior: Vec::new() });
        }
        let inner = Mat::from_fn(v.ncols(), v.ncols(), |a, b| factor.inner[(a, b)]);
        let weighed = v * &inner;
        let gv = times(g, v);
        let middle = v * (&inner * (v.transpose() * &gv) * &inner);
        let mut y = gv;
        estimate.cholesky.solve_block(y.as_mut())?;
        let answer = factor.answer_to_common_motion().ok_or(UncertaintyError::NoMinimum)?;
        let gauge = factor.gauge_modes();
        let mut own = Mat::from_fn(v.nrows(), v.ncols() - gauge.start, |row, k| factor.modes[(row, gauge.start + k)]);
        factor.solve_block(&estimate.cholesky, own.as_mut())?;
        // What the reports do not tell: of a common motion, the answer to it does; of a loose frame, nothing.
        let lost = |mode: usize| if mode < gauge.len() { 1.0 } else { 1.0 - (1.0 - LOOSE).powi(2) };
        let untold = Mat::from_fn(own.nrows(), own.ncols(), |row, mode| lost(mode) * own[(row, mode)]);
        let square = |of: &Mat<f64>, scale: f64| Product { left: of.clone(), right: of.clone(), scale };
        Ok(Self {
            posterior: vec![Product { left: weighed.clone(), right: v.clone(), scale: -2.0 }, square(&answer, 1.0)],
            propagated: vec![
                Product { left: weighed, right: y, scale: -2.0 },
                Product { left: middle, right: v.clone(), scale: 1.0 },
                Product { left: untold, right: own, scale: -estimate.prior().powi(2) },
                square(&answer, 1.0),
            ],
        })
    }

    fn products(&self, kind: Kind) -> &[Product] {
        match kind {
            Kind::Propagated => &self.propagated,
            Kind::Posterior => &self.posterior,
        }
    }

    /// Adds them to a covariance's entries on the pattern.
    pub fn add_to(&self, kind: Kind, covariance: &mut SystemMatrix) {
        let products = self.products(kind).iter();
        products.for_each(|own| covariance.add_products(&own.left, &own.right, own.scale));
    }

    /// Their share in the forms of columns of few unknowns each.
    pub fn forms<C: AsRef<[(usize, f64)]>>(&self, kind: Kind, columns: &[C]) -> Mat<f64> {
        let m = columns.len();
        let mut sum = Mat::<f64>::zeros(m, m);
        let project = |of: &Mat<f64>| {
            Mat::from_fn(m, of.ncols(), |a, k| {
                columns[a].as_ref().iter().map(|(unknown, value)| value * of[(*unknown, k)]).sum::<f64>()
            })
        };
        for own in self.products(kind) {
            let product = project(&own.left) * project(&own.right).transpose();
            let half = 0.5 * own.scale;
            sum += Mat::from_fn(m, m, |a, b| half * (product[(a, b)] + product[(b, a)]));
        }
        sum
    }

    /// Bytes they hold in memory.
    pub fn held_bytes(&self) -> usize {
        let bytes = |own: &Product| 8 * own.left.nrows() * (own.left.ncols() + own.right.ncols());
        self.propagated.iter().chain(&self.posterior).map(bytes).sum()
    }
}

fn times(matrix: &SystemMatrix, x: &Mat<f64>) -> Mat<f64> {
    let columns: Vec<Vec<f64>> = (0..x.ncols())
        .map(|column| matrix.times(&(0..x.nrows()).map(|row| x[(row, column)]).collect::<Vec<_>>()))
        .collect();
    Mat::from_fn(x.nrows(), x.ncols(), |row, column| columns[column][row])
}
