//! What any entry of either covariance can be formed from: the Hessian in all unknowns, and the inputs' columns.
//!
//! [`Factors::block`] solves for a window exactly. [`Factors::exported`] is what a client forms entries from by itself,
//! with `C = H^-1 B B^T H^-1`: refined poses are eliminated where that does not fill in too much,
//!
//! ```text
//! H' = H - K P^-1 K^T,   B' = B_c - K P^-1 B_e
//! ```
//!
//! with the common motion's share of the posterior put in, so that `2 H'^-1` is that, too;
//!
//! else they are three unknowns each behind the coefficients; known poses are columns of `B`.

use std::collections::BTreeMap;

use faer::linalg::solvers::{DenseSolveCore, Solve};
use faer::{Mat, Side};

use super::marginals::{ROUNDING, for_each_carried};
use super::{CompressedColumns, Kind, UncertaintyError};
use crate::fit::gauge::LOOSE;
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
/// Right-hand sides are solved for in panels of at most so many numbers.
const LARGEST_PANEL: usize = 4_000_000;

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

    /// Bytes it holds in memory, about.
    pub fn held_bytes(&self) -> usize {
        8 * self.system.hessian.values().len() + 24 * self.system.gradient.len() + self.inputs.held_bytes()
    }

    /// The number of coefficients: control points x components.
    pub fn coefficients(&self) -> usize {
        self.system.hessian.pattern().coefficients()
    }

    /// The dense covariance between the given coefficients, row-major, exact. `go_on` says whether to go on.
    pub fn block(&self, kind: Kind, points: &[usize], go_on: &dyn Fn() -> bool) -> Result<Vec<f64>, UncertaintyError> {
        let mut cholesky = Cholesky::analyse(self.system.hessian.pattern())?;
        let factor = Factor::factorise(&self.system, &mut cholesky)?;
        let answer = factor.answer_to_common_motion().ok_or(UncertaintyError::NoMinimum)?;
        let (unknowns, m) = (self.system.gradient.len(), points.len());
        let mut result = vec![0.0; m * m];
        let width = (LARGEST_PANEL / unknowns).clamp(1, 256);
        for first in (0..m).step_by(width) {
            if !go_on() {
                return Err(UncertaintyError::Cancelled);
            }
            let panel = &points[first..(first + width).min(m)];
            let mut x = Mat::from_fn(unknowns, panel.len(), |row, k| f64::from(u8::from(row == panel[k])));
            factor.solve_block(&cholesky, x.as_mut())?;
            if kind == Kind::Propagated {
                self.times_input_covariance(&mut x);
                factor.solve_block(&cholesky, x.as_mut())?;
            } else {
                x *= faer::Scale(2.0);
            }
            for (k, column) in panel.iter().enumerate() {
                for (a, &row) in points.iter().enumerate() {
                    let moved: f64 =
                        (0..answer.ncols()).map(|mode| answer[(row, mode)] * answer[(*column, mode)]).sum();
                    result[a * m + first + k] = x[(row, k)] + moved;
                }
            }
        }
        symmetrise(&mut result, m);
        Ok(result)
    }

    /// Replaces every column by the inputs' covariance times it, but for the common motion of the reports.
    fn times_input_covariance(&self, x: &mut Mat<f64>) {
        let first_pose = self.coefficients();
        let diagonal = self.system.hessian.diagonal();
        let gauge = &self.system.gauge;
        for k in 0..x.ncols() {
            let own: Vec<f64> = (0..x.nrows()).map(|row| x[(row, k)]).collect();
            let mut image: Vec<f64> = own.iter().zip(&diagonal).map(|(x, d)| ROUNDING.powi(2) * d * x).collect();
            image[first_pose..].fill(0.0);
            for input in 0..self.inputs.columns() {
                let share: f64 = self.inputs.column(input).map(|(row, b)| b * own[row]).sum();
                self.inputs.column(input).for_each(|(row, b)| image[row] += b * share);
            }
            let squared = self.prior.powi(2);
            image[first_pose..].iter_mut().zip(&own[first_pose..]).for_each(|(image, x)| *image += squared * x);
            for (mode, along) in gauge.along(&own[first_pose..]).into_iter().enumerate() {
                // What the reports do not tell: of a common motion, the answer to it does; of a loose frame, nothing.
                let lost = if mode < gauge.held { 1.0 } else { 1.0 - (1.0 - LOOSE).powi(2) };
                image[first_pose..]
                    .iter_mut()
                    .enumerate()
                    .for_each(|(row, v)| *v -= squared * lost * along * gauge.columns[(row, mode)]);
            }
            image.iter().enumerate().for_each(|(row, value)| x[(row, k)] = *value);
        }
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

    fn bordered(&self) -> ExportedFactors {
        let (n, unknowns) = (self.coefficients(), self.system.gradient.len());
        let mut columns = self.columns();
        let reports = self.reports();
        for (a, b) in (0..unknowns - n).flat_map(|a| (0..unknowns - n).map(move |b| (a, b))) {
            let spring = reports[(a, b)] - if a == b { self.prior } else { 0.0 };
            if spring != 0.0 {
                *columns[n + b].entry(n + a).or_default() += spring;
            }
        }
        let mut inputs = self.inputs.clone();
        for b in 0..unknowns - n {
            inputs.push((0..unknowns - n).map(|a| (n + a, reports[(a, b)])).filter(|(_, v)| *v != 0.0));
        }
        ExportedFactors {
            hessian: CompressedColumns::of(unknowns, columns.into_iter().map(|c| c.into_iter().collect())),
            inputs,
        }
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

fn symmetrise(matrix: &mut [f64], n: usize) {
    for row in 0..n {
        for column in 0..row {
            let mean = 0.5 * (matrix[row * n + column] + matrix[column * n + row]);
            matrix[row * n + column] = mean;
            matrix[column * n + row] = mean;
        }
    }
}
