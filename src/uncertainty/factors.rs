//! What a client can form any entry of the covariance from by itself: the Hessian in all unknowns, and the inputs' columns.
//!
//! With [`Factors::exported`] it is `C = H^-1 B B^T H^-1`: refined poses are eliminated where that does not fill in too much,
//!
//! ```text
//! H' = H - K P^-1 K^T,   B' = B_c - K P^-1 B_e
//! ```
//!
//! with the common motion's share of the posterior put in, so that `2 H'^-1` is that, too; else they are three unknowns each behind the coefficients,
//! and every common motion one more (`Factors::bordered`); known poses are columns of `B`.

use std::collections::BTreeMap;

use faer::linalg::solvers::{DenseSolveCore, Solve};
use faer::{Mat, Side};

use super::marginals::for_each_carried;
use super::{CompressedColumns, UncertaintyError};
use crate::fit::{Estimate, Factor, Poses, System};
use crate::sparse::Cholesky;
use crate::spline::SUPPORT;

/// The Hessian and the inputs of an estimate; see the module.
pub struct Factors {
    system: System,
    poses: Poses,
    /// The curvature of the poses' prior.
    prior: f64,
    /// All inputs but the poses' reports: unknowns x inputs.
    inputs: CompressedColumns,
}

/// Hessian and inputs for a client: `propagated = H^-1 B B^T H^-1`.
pub struct ExportedFactors {
    pub hessian: CompressedColumns,
    pub inputs: CompressedColumns,
}

/// Pose unknowns that are eliminated at most: beyond, the dense block between them is what costs.
const LARGEST_ELIMINATION: usize = 600;

impl Factors {
    /// The factors of an estimate.
    pub fn of(estimate: &mut Estimate) -> Result<Self, UncertaintyError> {
        estimate.match_pattern()?;
        let pattern = estimate.system.hessian.pattern();
        let (n, first_pose) = (pattern.stencil().dimension(), pattern.coefficients());
        let row = pattern.stencil().size()[0];
        let mut inputs = CompressedColumns::new(pattern.dimension());
        for_each_carried(estimate, &mut |input| {
            let point = |k: usize| input.first + k % 4 + k / 4 * row;
            let rows = input.by_control_points[..pattern.components()].iter().enumerate();
            let on_map = rows.flat_map(|(axis, own)| (0..SUPPORT).map(move |k| (axis * n + point(k), own[k])));
            let poses = input.by_poses.iter();
            let on_poses = poses.flat_map(|(pose, own)| (0..3).map(move |a| (first_pose + 3 * pose + a, own[a])));
            inputs.push(on_map.chain(on_poses).filter(|(_, value)| *value != 0.0));
        });
        Ok(Self { system: estimate.system.clone(), poses: estimate.weights.poses, prior: estimate.prior(), inputs })
    }

    /// The number of coefficients: control points x components.
    pub fn coefficients(&self) -> usize {
        self.system.hessian.pattern().coefficients()
    }

    /// What a client needs; see the module. Poses are eliminated where that takes at most `limit` entries.
    pub fn exported(&self, limit: usize) -> ExportedFactors {
        match self.poses {
            Poses::Fixed => self.with_known_poses(),
            Poses::Refined => self.eliminated(limit).unwrap_or_else(|| self.bordered()),
        }
    }

    /// The Hessian's columns between all unknowns, both triangles, without the gauge's share.
    fn columns(&self) -> Vec<BTreeMap<usize, f64>> {
        let hessian = &self.system.hessian;
        let mut columns = vec![BTreeMap::new(); hessian.pattern().dimension()];
        for (row, column, at) in hessian.pattern().entries() {
            let value = hessian.values()[at];
            columns[column].insert(row, value);
            columns[row].insert(column, value);
        }
        columns
    }

    fn with_known_poses(&self) -> ExportedFactors {
        let n = self.coefficients();
        let columns = self.columns();
        let within = |column: &BTreeMap<usize, f64>| column.range(..n).map(|(row, v)| (*row, *v)).collect::<Vec<_>>();
        let hessian = CompressedColumns::of(n, columns[..n].iter().map(within));
        let mut inputs = CompressedColumns::new(n);
        (0..self.inputs.columns()).for_each(|k| inputs.push(self.inputs.column(k)));
        columns[n..].iter().for_each(|column| inputs.push(within(column)));
        ExportedFactors { hessian, inputs }
    }

    /// The reports' columns of `B`, by pose unknowns: `(p I + 2 kappa U U^T)`.
    fn reports(&self) -> Mat<f64> {
        let unknowns = self.system.gradient.len() - self.coefficients();
        let spring = match self.system.gauge.ncols() {
            0 => Mat::zeros(unknowns, unknowns),
            _ => self.system.gauge.spring(),
        };
        Mat::from_fn(unknowns, unknowns, |a, b| spring[(a, b)] + if a == b { self.prior } else { 0.0 })
    }

    /// With the poses, and each common motion by one unknown more, so that the Hessian has no dense block:
    ///
    /// ```text
    /// H = [ M0            r u      ]     r^2 = |2 s|: eliminating it gives M0 + 2 s u u^T
    ///     [ r u^T     -sign(2 s)   ]
    /// B B^T = inputs + p^2 I + (4 s p + 4 s^2) u u^T        u orthonormal, s > 0
    /// ```
    ///
    /// `H` is indefinite then, and its inverse's rows of coefficients what they were. A loose frame takes from what its
    /// scans' reports tell, which no further column can: their reports' columns are dense.
    fn bordered(&self) -> ExportedFactors {
        let (n, unknowns) = (self.coefficients(), self.system.gradient.len());
        let motions = &self.system.gauge;
        let count = motions.ncols();
        let mut columns: Vec<Vec<(usize, f64)>> = self.columns().into_iter().map(|c| c.into_iter().collect()).collect();
        let root = |motion: usize| (2.0 * motions.stiffness(motion)).abs().sqrt();
        let tie = |pose: usize, motion: usize| root(motion) * motions.columns[(pose, motion)];
        for (pose, motion) in (0..unknowns - n).flat_map(|pose| (0..count).map(move |motion| (pose, motion))) {
            columns[n + pose].push((unknowns + motion, tie(pose, motion)));
        }
        for motion in 0..count {
            let ties = (0..unknowns - n).map(|pose| (n + pose, tie(pose, motion)));
            columns.push(ties.chain([(unknowns + motion, -motions.stiffness(motion).signum())]).collect());
        }
        let mut inputs = CompressedColumns::new(unknowns + count);
        (0..self.inputs.columns()).for_each(|k| inputs.push(self.inputs.column(k)));
        if motions.held == count {
            (n..unknowns).for_each(|pose| inputs.push([(pose, self.prior)]));
            for motion in 0..count {
                let stiffness = motions.stiffness(motion);
                let common = (4.0 * stiffness * (self.prior + stiffness)).sqrt();
                inputs.push((0..unknowns - n).map(|pose| (n + pose, common * motions.columns[(pose, motion)])));
            }
        } else {
            let reports = self.reports();
            for b in 0..unknowns - n {
                inputs.push((0..unknowns - n).map(|a| (n + a, reports[(a, b)])).filter(|(_, v)| *v != 0.0));
            }
        }
        ExportedFactors { hessian: CompressedColumns::of(unknowns + count, columns), inputs }
    }

    /// The share `R R^T` of the posterior that is the common motion's, as a change of the eliminated Hessian, so that its
    /// inverse holds it, too (Woodbury): `(H'^-1 + R R^T / 2)^-1 = H' - H' R T R^T H'`, `T = (2 I + R^T H' R)^-1`. `H' R`
    /// lives on what poses see.
    fn common_motion(&self, columns: &[BTreeMap<usize, f64>], seen: &[usize]) -> Option<CommonMotion> {
        let mut cholesky = Cholesky::analyse(self.system.hessian.pattern()).ok()?;
        let factor = Factor::factorise(&self.system, &mut cholesky).ok()?;
        let answer = factor.answer_to_common_motion()?;
        let modes = answer.ncols();
        let answer: Vec<Vec<f64>> =
            (0..modes).map(|mode| (0..columns.len()).map(|row| answer[(row, mode)]).collect()).collect();
        let bent = Mat::from_fn(seen.len(), modes, |a, mode| {
            columns[seen[a]].range(..columns.len()).map(|(row, value)| value * answer[mode][*row]).sum::<f64>()
        });
        let inner = Mat::from_fn(modes, modes, |a, b| {
            let overlap: f64 = seen.iter().enumerate().map(|(k, &row)| answer[a][row] * bent[(k, b)]).sum();
            overlap + if a == b { 2.0 } else { 0.0 }
        });
        let share = if modes > 0 { inner.partial_piv_lu().inverse() } else { Mat::zeros(0, 0) };
        let pull = &bent * share;
        let lost = &pull * bent.transpose();
        let lost = Mat::from_fn(seen.len(), seen.len(), |a, b| 0.5 * (lost[(a, b)] + lost[(b, a)]));
        Some(CommonMotion { answer, pull, lost })
    }

    /// With the poses eliminated, or `None` where that would take more than `limit` entries. Whatever any scan saw is
    /// coupled then: the gauge ties all poses together.
    fn eliminated(&self, limit: usize) -> Option<ExportedFactors> {
        let (n, unknowns) = (self.coefficients(), self.system.gradient.len() - self.coefficients());
        let mut columns = self.columns();
        let mut seen: Vec<usize> =
            columns[n..].iter().flat_map(|column| column.range(..n).map(|(row, _)| *row)).collect();
        seen.sort_unstable();
        seen.dedup();
        let bordered = |k: usize| self.inputs.column(k).any(|(row, _)| row >= n);
        let filled = (0..self.inputs.columns()).filter(|&k| bordered(k)).count() + unknowns;
        if unknowns > LARGEST_ELIMINATION || seen.len().saturating_mul(seen.len() + filled) > limit {
            return None;
        }
        let place = |row: usize| seen.partition_point(|&other| other < row);
        let (mut coupling, mut block) =
            (Mat::<f64>::zeros(seen.len(), unknowns), gauge_block(&self.reports(), self.prior));
        for (k, column) in columns.drain(n..).enumerate() {
            for (row, value) in column {
                match row.checked_sub(n) {
                    Some(pose) => block[(pose, k)] += value,
                    None => coupling[(place(row), k)] = value,
                }
            }
        }
        // P^-1 K^T: the elimination of both, Hessian and inputs.
        let image = block.llt(Side::Lower).ok()?.solve(coupling.transpose());
        let lost = &coupling * &image;
        // Symmetric to the last bit, whichever way the products were summed.
        let lost = Mat::from_fn(seen.len(), seen.len(), |a, b| 0.5 * (lost[(a, b)] + lost[(b, a)]));
        for ((b, &column), (a, &row)) in pairs(&seen) {
            *columns[column].entry(row).or_default() -= lost[(a, b)];
        }
        let common = self.common_motion(&columns[..n], &seen)?;
        for ((b, &column), (a, &row)) in pairs(&seen) {
            *columns[column].entry(row).or_default() -= common.lost[(a, b)];
        }
        let within = |column: BTreeMap<usize, f64>| column.into_iter().filter(|(row, _)| *row < n).collect();
        let mut inputs = CompressedColumns::new(n);
        let mut taken: Vec<(usize, f64)> = Vec::new();
        let mut push = |own: &mut dyn Iterator<Item = (usize, f64)>| {
            let mut reduced = BTreeMap::<usize, f64>::new();
            for (row, value) in own {
                match row.checked_sub(n) {
                    None => *reduced.entry(row).or_default() += value,
                    Some(pose) => {
                        for (a, &row) in seen.iter().enumerate() {
                            *reduced.entry(row).or_default() -= image[(pose, a)] * value;
                        }
                    }
                }
            }
            for (mode, answer) in common.answer.iter().enumerate() {
                let along: f64 = reduced.iter().map(|(row, value)| answer[*row] * value).sum();
                let pulls = seen.iter().enumerate().map(|(a, &row)| (row, common.pull[(a, mode)]));
                taken.extend(pulls.map(|(row, pull)| (row, pull * along)));
            }
            taken.drain(..).for_each(|(row, value)| *reduced.entry(row).or_default() -= value);
            inputs.push(reduced);
        };
        (0..self.inputs.columns()).for_each(|k| push(&mut self.inputs.column(k)));
        let reports = self.reports();
        (0..unknowns).for_each(|b| push(&mut (0..unknowns).map(|a| (n + a, reports[(a, b)]))));
        Some(ExportedFactors { hessian: CompressedColumns::of(n, columns.into_iter().map(within)), inputs })
    }
}

/// See [`Factors::common_motion`].
struct CommonMotion {
    /// `R` on the coefficients, mode by mode.
    answer: Vec<Vec<f64>>,
    /// `H' R T` on what poses see, and `H' R T R^T H'`.
    pull: Mat<f64>,
    lost: Mat<f64>,
}

/// All pairs, column by column.
fn pairs(seen: &[usize]) -> impl Iterator<Item = ((usize, &usize), (usize, &usize))> {
    seen.iter().enumerate().flat_map(|column| seen.iter().enumerate().map(move |row| (column, row)))
}

/// The gauge's share of the poses' block.
fn gauge_block(reports: &Mat<f64>, prior: f64) -> Mat<f64> {
    Mat::from_fn(reports.nrows(), reports.ncols(), |a, b| reports[(a, b)] - if a == b { prior } else { 0.0 })
}
