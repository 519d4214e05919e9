//! The dense covariance between any few coefficients, exact, however far apart they are.
//!
//! A query needs entries between control points that share a cell; [`super::Marginals`] has those. What lies farther apart
//! is formed here on demand, from the elimination's paths (see [`crate::sparse::Paths`]) and the pin's and gauge's columns.

use super::marginals::input_covariance;
use super::modes::Modes;
use super::{Kind, UncertaintyError};
use crate::fit::{Estimate, Factor};
use crate::sparse::{Of, Paths, Team};

/// Gives any dense block of either covariance; see the module.
pub struct Joint {
    paths: Paths,
    modes: Modes,
}

/// How much of the work is done before the elimination's derivative is begun.
const FACTORISED: f64 = 0.3;

impl Joint {
    /// From an estimate. `go_on` is told which share of the work is done and says whether to go on.
    pub fn of(mut estimate: Estimate, go_on: &dyn Fn(f64) -> bool) -> Result<Self, UncertaintyError> {
        let factor = Factor::factorise(&estimate.system, &mut estimate.cholesky)?;
        if !go_on(FACTORISED) {
            return Err(UncertaintyError::Cancelled);
        }
        let g = input_covariance(&estimate);
        let modes = Modes::of(&estimate, &factor, &g)?;
        drop(factor);
        let Estimate { cholesky, .. } = estimate;
        let paths = Paths::of(cholesky, &g, &|share| go_on(FACTORISED + (1.0 - FACTORISED) * share))?;
        Ok(Self { paths, modes })
    }

    /// Bytes it holds in memory.
    pub fn held_bytes(&self) -> usize {
        self.paths.held_bytes() + self.modes.held_bytes()
    }

    /// Bytes that [`Joint::block`] holds while it forms one.
    pub fn block_bytes(&self, points: &[usize]) -> Result<usize, UncertaintyError> {
        Ok(self.paths.forming_bytes(&units(points))?)
    }

    /// Bytes that [`Joint::forms`] holds while it forms so many, at most.
    pub fn most_bytes(&self, columns: usize) -> usize {
        self.paths.most_bytes(columns)
    }

    /// The covariance between coefficients (by their index, x set before y set), each named once: row-major, square
    /// metres. `go_on` says whether to go on.
    pub fn block(
        &self,
        kind: Kind,
        points: &[usize],
        team: &Team,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Vec<f64>, UncertaintyError> {
        self.forms(kind, &units(points), team, go_on)
    }

    /// The covariance between weighted sums of coefficients, (index, weight) each: row-major. `go_on` says whether to go on.
    pub fn forms<C: AsRef<[(usize, f64)]>>(
        &self,
        kind: Kind,
        columns: &[C],
        team: &Team,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Vec<f64>, UncertaintyError> {
        let (of, factor) = match kind {
            Kind::Propagated => (Of::Sandwich, 1.0),
            Kind::Posterior => (Of::Inverse, 2.0),
        };
        let pinned = self.paths.forms(columns, of, team, go_on)?;
        let moved = self.modes.forms(kind, columns);
        let m = columns.len();
        Ok((0..m * m).map(|k| factor * pinned[(k / m, k % m)] + moved[(k / m, k % m)]).collect())
    }
}

/// Every coefficient by itself.
fn units(points: &[usize]) -> Vec<[(usize, f64); 1]> {
    points.iter().map(|&point| [(point, 1.0)]).collect()
}
