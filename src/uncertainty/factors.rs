//! What any entry of either covariance can be formed from: the Hessian in all unknowns, and the inputs' columns.
//!
//! `M` is bordered where poses were refined (control points first, then three unknowns a scan), and `B` has a column a
//! return and three a scan: `propagated = M^-1 B B^T M^-1`, `posterior = 2 M^-1`, both at the control points.
//! [`Factors::reduced`] eliminates the poses, so that a client deals in control points alone:
//!
//! ```text
//! H' = H - K P^-1 K^T,   B' = B_c - K P^-1 B_e,   propagated = H'^-1 B' B'^T H'^-1,   posterior = 2 H'^-1
//! ```
//!
//! Where the map is a vector field, `M` has its two components one after the other, with one `H` for both.
//!
//! That fills in what any scan saw; it is refused where that is too much. The *posterior* has the gauge's share besides
//! ([`gauge`]): `W U U^T W^T`, `W = H^-1 K`, which the eliminated form has inside `H'`.

use std::collections::BTreeMap;
use std::sync::Arc;

use faer::linalg::solvers::{DenseSolveCore, Solve};
use faer::{Mat, Side};
use nalgebra::Matrix3;

use super::inputs::{CompressedColumns, for_each_misfit, for_each_return};
use super::marginals::settle;
use super::{Kind, UncertaintyError};
use crate::fit::{Bordered, Fit, Poses, System, pose_block, solve_components};
use crate::sparse::{Cholesky, Stencil, StencilMatrix};

/// The Hessian and the inputs of a fit; see the module.
#[derive(Debug, Clone)]
pub struct Factors {
    /// `H`, of each component.
    pub hessian: StencilMatrix,
    /// `K`: coefficients (of all components) x pose unknowns.
    pub coupling: CompressedColumns,
    /// `P`, block by block, without the gauge's share.
    pub poses: Vec<Matrix3<f64>>,
    /// `U` of [`crate::fit::gauge`]: `P` has `2 kappa U U^T` more.
    pub gauge: Mat<f64>,
    /// `B`: (coefficients + pose unknowns) x inputs.
    pub inputs: CompressedColumns,
    /// A second component with a Hessian and inputs of its own, taken apart from this one (the published vector form).
    pub apart: Option<Box<Factors>>,
}

/// See [`Factors::common_motion`]: `m`, `V` on what scans saw, `T`.
struct CommonMotion {
    moved: Mat<f64>,
    pull: Mat<f64>,
    share: Mat<f64>,
}

/// Hessian and inputs on the coefficients alone: `propagated = H^-1 B B^T H^-1`, `posterior = 2 H^-1`.
pub struct Reduced {
    pub hessian: CompressedColumns,
    pub inputs: CompressedColumns,
}

/// Pose unknowns that are eliminated at most: beyond, the dense block between them is what costs.
const LARGEST_ELIMINATION: usize = 600;

/// Right-hand sides are solved for in blocks of this many.
const COLUMNS_A_BLOCK: usize = 256;

impl Factors {
    /// The factors of a fit.
    pub fn of(fit: &mut Fit) -> Result<Self, UncertaintyError> {
        settle(fit)?;
        let (n, refined) = (fit.cholesky.dimension(), fit.weights.poses == Poses::Refined);
        let unknowns = fit.unknowns.len();
        let scans = fit.poses.len();
        let mut inputs = CompressedColumns::new(unknowns);
        let mut pose_columns = vec![BTreeMap::<usize, [f64; 3]>::new(); scans];
        for_each_return(fit, |range, pose| {
            let border = (0..3).map(|a| (n + 3 * range.scan + a, range.by_pose[a]));
            let own = range.support.iter().copied().zip(range.by_control_points);
            inputs.push(own.chain(border.filter(|_| refined)));
            for (k, &row) in pose.support.iter().enumerate() {
                let entry = pose_columns[pose.scan].entry(row).or_default();
                (0..3).for_each(|a| entry[a] += pose.by_control_points[a][k]);
            }
        });
        for_each_misfit(fit, |support, score| inputs.push(support.iter().copied().zip(*score)));
        let mut coupling = CompressedColumns::new(n);
        for (scan, columns) in pose_columns.iter().enumerate() {
            for a in 0..3 {
                let own = columns.iter().map(|(&row, values)| (row, values[a]));
                if refined {
                    coupling.push(own.clone());
                    let block = fit.system.poses[scan] - Matrix3::identity() * 2.0;
                    inputs.push(own.chain((0..3).map(|b| (n + 3 * scan + b, block[(b, a)]))));
                } else {
                    inputs.push(own);
                }
            }
        }
        Ok(Self {
            hessian: fit.system.hessian.clone(),
            coupling,
            poses: fit.system.poses.clone(),
            gauge: fit.system.gauge.clone(),
            inputs,
            apart: None,
        })
    }

    /// Factors from their parts, which must fit each other.
    pub fn from_parts(
        stencil: Arc<Stencil>,
        hessian: Vec<f64>,
        coupling: CompressedColumns,
        poses: Vec<Matrix3<f64>>,
        gauge: Mat<f64>,
        inputs: CompressedColumns,
    ) -> Result<Self, UncertaintyError> {
        let n = stencil.dimension();
        let mut matrix = StencilMatrix::zeros(stencil);
        if matrix.values.len() != hessian.len() {
            return Err(UncertaintyError::Malformed("the Hessian has another lattice's size"));
        }
        matrix.values = hessian;
        if coupling.rows == 0 || !coupling.rows.is_multiple_of(n) {
            return Err(UncertaintyError::Malformed("the border has another lattice's size"));
        }
        if coupling.columns() != 3 * poses.len() || inputs.rows != coupling.rows + 3 * poses.len() {
            return Err(UncertaintyError::Malformed("border and inputs have different numbers of poses"));
        }
        if gauge.ncols() > 0 && gauge.nrows() != 3 * poses.len() {
            return Err(UncertaintyError::Malformed("the gauge has another number of poses"));
        }
        Ok(Self { hessian: matrix, coupling, poses, gauge, inputs, apart: None })
    }

    /// The number of coefficients: control points x components, without those of a component apart.
    pub fn coefficients(&self) -> usize {
        self.coupling.rows
    }

    /// The Hessian's entries between coefficients, both triangles.
    fn hessian_entries(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let n = self.hessian.stencil().dimension();
        (0..self.coefficients() / n).flat_map(move |k| {
            let entries = self.hessian.stencil().entries().zip(&self.hessian.values);
            entries.flat_map(move |((row, column), &value)| {
                let lower = Some((k * n + row, k * n + column, value));
                lower.into_iter().chain((row != column).then_some((k * n + column, k * n + row, value)))
            })
        })
    }

    /// The dense covariance between the given coefficients, row-major, exact.
    pub fn block(&self, kind: Kind, points: &[usize]) -> Result<Vec<f64>, UncertaintyError> {
        match &self.apart {
            Some(apart) => self.block_apart(apart, kind, points),
            None => self.block_alone(kind, points),
        }
    }

    /// [`Factors::block`] of this component.
    fn block_alone(&self, kind: Kind, points: &[usize]) -> Result<Vec<f64>, UncertaintyError> {
        let mut cholesky = Cholesky::analyse(self.hessian.stencil())?;
        let system = self.system();
        let border = Bordered::factorise(&system, &mut cholesky)?;
        let (n, m) = (self.coefficients(), points.len());
        let mut result = vec![0.0; m * m];
        for first in (0..m).step_by(COLUMNS_A_BLOCK) {
            let width = COLUMNS_A_BLOCK.min(m - first);
            let mut x = Mat::<f64>::zeros(n + self.coupling.columns(), width);
            (0..width).for_each(|k| x[(points[first + k], k)] = 1.0);
            border.solve_block(&cholesky, x.as_mut())?;
            let scale = match kind {
                Kind::Posterior => 2.0,
                Kind::Propagated => {
                    self.times_input_covariance(&mut x);
                    border.solve_block(&cholesky, x.as_mut())?;
                    1.0
                }
            };
            for k in 0..width {
                for (row, &point) in points.iter().enumerate() {
                    result[row * m + first + k] = scale * x[(point, k)];
                }
            }
        }
        if kind == Kind::Posterior {
            let moved = &border.w * &self.gauge;
            let on_points = Mat::from_fn(m, self.gauge.ncols(), |k, mode| moved[(points[k], mode)]);
            let shared = &on_points * on_points.transpose();
            (0..m * m).for_each(|k| result[k] += shared[(k / m, k % m)]);
        }
        symmetrise(&mut result, m);
        Ok(result)
    }

    /// [`Factors::block`] where there is a component apart: nothing between this one and that.
    fn block_apart(&self, apart: &Self, kind: Kind, points: &[usize]) -> Result<Vec<f64>, UncertaintyError> {
        let (n, m) = (self.coefficients(), points.len());
        let mut result = vec![0.0; m * m];
        for (own, first) in [(self, 0), (apart, n)] {
            let of_its: Vec<usize> = (0..m).filter(|&k| (first..first + n).contains(&points[k])).collect();
            let places: Vec<usize> = of_its.iter().map(|&k| points[k] - first).collect();
            let block = own.block_alone(kind, &places)?;
            for (a, &row) in of_its.iter().enumerate() {
                of_its
                    .iter()
                    .enumerate()
                    .for_each(|(b, &column)| result[row * m + column] = block[a * of_its.len() + b]);
            }
        }
        Ok(result)
    }

    /// All inputs' columns, those of a component apart below and after.
    pub fn all_inputs(&self) -> CompressedColumns {
        match &self.apart {
            Some(apart) => self.inputs.clone().beside(&apart.inputs),
            None => self.inputs.clone(),
        }
    }

    /// Replaces every column by `B B^T` times it.
    fn times_input_covariance(&self, x: &mut Mat<f64>) {
        let mut image = vec![0.0; x.nrows()];
        for k in 0..x.ncols() {
            image.fill(0.0);
            for input in 0..self.inputs.columns() {
                let share: f64 = self.inputs.column(input).map(|(row, b)| b * x[(row, k)]).sum();
                self.inputs.column(input).for_each(|(row, b)| image[row] += b * share);
            }
            image.iter().enumerate().for_each(|(row, value)| x[(row, k)] = *value);
        }
    }

    /// The factors with the poses eliminated, or `None` where that would take more than `limit` entries. Whatever any
    /// scan saw is coupled then: the gauge ties all poses together.
    pub fn reduced(&self, limit: usize) -> Option<Reduced> {
        let own = self.reduced_alone(limit)?;
        let Some(apart) = &self.apart else { return Some(own) };
        let other = apart.reduced_alone(limit)?;
        let (hessian, inputs) = (own.hessian.beside(&other.hessian), own.inputs.beside(&other.inputs));
        Some(Reduced { hessian, inputs })
    }

    /// [`Factors::reduced`] of this component.
    fn reduced_alone(&self, limit: usize) -> Option<Reduced> {
        let (n, unknowns) = (self.coefficients(), self.coupling.columns());
        let mut seen: Vec<usize> = (0..unknowns).flat_map(|k| self.coupling.column(k)).map(|(row, _)| row).collect();
        seen.sort_unstable();
        seen.dedup();
        let bordered = |k: usize| self.inputs.column(k).any(|(row, _)| row >= n);
        let filled = (0..self.inputs.columns()).filter(|&k| bordered(k)).count();
        let fill = seen.len().saturating_mul(seen.len() + filled);
        if unknowns > LARGEST_ELIMINATION || fill.saturating_add(self.hessian.values.len()) > limit {
            return None;
        }
        let place = |row: usize| seen.partition_point(|&other| other < row);
        let mut coupling = Mat::<f64>::zeros(seen.len(), unknowns);
        for k in 0..unknowns {
            self.coupling.column(k).for_each(|(row, value)| coupling[(place(row), k)] = value);
        }
        // P^-1 K^T: the elimination of both, Hessian and inputs.
        let image = pose_block(&self.poses, &self.gauge).llt(Side::Lower).ok()?.solve(coupling.transpose());
        let mut lost = &coupling * &image;
        let common = self.common_motion(&seen, &coupling, &lost)?;
        lost += &common.pull * &common.share * common.pull.transpose();
        let mut hessian = vec![BTreeMap::<usize, f64>::new(); n];
        self.hessian_entries().for_each(|(row, column, value)| _ = hessian[column].insert(row, value));
        for (a, &row) in seen.iter().enumerate() {
            for (b, &column) in seen.iter().enumerate() {
                // Symmetric to the last bit, whichever way the products were summed.
                *hessian[column].entry(row).or_default() -= 0.5 * (lost[(a, b)] + lost[(b, a)]);
            }
        }
        let mut columns = CompressedColumns::new(n);
        hessian.into_iter().for_each(|column| columns.push(column));
        let mut inputs = CompressedColumns::new(n);
        for k in 0..self.inputs.columns() {
            let mut own: BTreeMap<usize, f64> = self.inputs.column(k).filter(|&(row, _)| row < n).collect();
            for (unknown, share) in self.inputs.column(k).filter(|&(row, _)| row >= n) {
                for (a, &row) in seen.iter().enumerate() {
                    *own.entry(row).or_default() -= image[(unknown - n, a)] * share;
                }
            }
            // B' - V T m^T B'
            let mut moved = Mat::<f64>::zeros(common.moved.ncols(), 1);
            for (&row, value) in &own {
                (0..moved.nrows()).for_each(|mode| moved[(mode, 0)] += common.moved[(row, mode)] * value);
            }
            let change = &common.pull * (&common.share * moved);
            if common.pull.ncols() > 0 {
                seen.iter().enumerate().for_each(|(a, &row)| *own.entry(row).or_default() -= change[(a, 0)]);
            }
            inputs.push(own);
        }
        Some(Reduced { hessian: columns, inputs })
    }

    /// The gauge's share of the posterior, `m m^T`, as a change of the eliminated Hessian `H'` (Woodbury):
    /// `(H'^-1 + m m^T / 2)^-1 = H' - V T V^T` with `V = H' m`, `T = (2 I + m^T V)^-1`. `V` lives where scans saw
    /// something.
    fn common_motion(&self, seen: &[usize], coupling: &Mat<f64>, lost: &Mat<f64>) -> Option<CommonMotion> {
        let (n, modes) = (self.coefficients(), self.gauge.ncols());
        let mut moved = Mat::<f64>::zeros(n, modes);
        if modes == 0 {
            return Some(CommonMotion { moved, pull: Mat::zeros(seen.len(), 0), share: Mat::zeros(0, 0) });
        }
        let pushed = coupling * &self.gauge;
        for (a, &row) in seen.iter().enumerate() {
            (0..modes).for_each(|k| moved[(row, k)] = pushed[(a, k)]);
        }
        let mut cholesky = Cholesky::analyse(self.hessian.stencil()).ok()?;
        cholesky.factorise(&self.hessian).ok()?;
        solve_components(&cholesky, moved.as_mut()).ok()?;
        let on_seen = Mat::from_fn(seen.len(), modes, |a, k| moved[(seen[a], k)]);
        let pull = pushed - lost * &on_seen;
        let mut inner = on_seen.transpose() * &pull;
        (0..modes).for_each(|k| inner[(k, k)] += 2.0);
        let share = inner.partial_piv_lu().inverse();
        Some(CommonMotion { moved, pull, share })
    }

    /// `M` whole, both triangles.
    pub fn bordered_hessian(&self) -> CompressedColumns {
        let n = self.coefficients();
        let mut columns = vec![BTreeMap::<usize, f64>::new(); n + self.coupling.columns()];
        self.hessian_entries().for_each(|(row, column, value)| _ = columns[column].insert(row, value));
        for k in 0..self.coupling.columns() {
            for (row, value) in self.coupling.column(k) {
                columns[n + k].insert(row, value);
                columns[row].insert(n + k, value);
            }
        }
        let block = pose_block(&self.poses, &self.gauge);
        for k in 0..block.ncols() {
            let own = (0..block.nrows()).filter(|&row| row / 3 == k / 3 || self.gauge.ncols() > 0);
            own.for_each(|row| _ = columns[n + k].insert(n + row, block[(row, k)]));
        }
        let mut whole = CompressedColumns::new(columns.len());
        columns.into_iter().for_each(|column| whole.push(column));
        match &self.apart {
            Some(apart) => whole.beside(&apart.bordered_hessian()),
            None => whole,
        }
    }

    fn system(&self) -> System {
        let n = self.coefficients();
        let mut coupling = Mat::zeros(n, self.coupling.columns());
        for column in 0..self.coupling.columns() {
            self.coupling.column(column).for_each(|(row, value)| coupling[(row, column)] = value);
        }
        let gradient = vec![0.0; n + coupling.ncols()];
        System {
            gradient,
            hessian: self.hessian.clone(),
            coupling,
            poses: self.poses.clone(),
            gauge: self.gauge.clone(),
        }
    }
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
