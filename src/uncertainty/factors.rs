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
//! That fills in what each scan saw; it is refused where that is too much.

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use super::inputs::{CompressedColumns, for_each_return};
use super::marginals::settle;
use super::{Kind, UncertaintyError};
use crate::fit::{Bordered, Fit, Poses, System};
use crate::sparse::{Cholesky, Stencil, StencilMatrix};
use crate::spline::Lattice;

/// The Hessian and the inputs of a fit; see the module.
#[derive(Debug, Clone)]
pub struct Factors {
    pub hessian: StencilMatrix,
    /// `K`: control points x pose unknowns.
    pub coupling: CompressedColumns,
    /// `P`, block by block.
    pub poses: Vec<Matrix3<f64>>,
    /// `B`: (control points + pose unknowns) x inputs.
    pub inputs: CompressedColumns,
}

/// Hessian and inputs on the control points alone.
pub struct Reduced {
    pub hessian: CompressedColumns,
    pub inputs: CompressedColumns,
}

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
        let mut pose_columns = vec![std::collections::BTreeMap::<usize, [f64; 3]>::new(); scans];
        for_each_return(fit, |range, pose| {
            let border = (0..3).map(|a| (n + 3 * range.scan + a, range.by_pose[a]));
            let own = range.support.iter().copied().zip(range.by_control_points);
            inputs.push(own.chain(border.filter(|_| refined)));
            for (k, &row) in pose.support.iter().enumerate() {
                let entry = pose_columns[pose.scan].entry(row).or_default();
                (0..3).for_each(|a| entry[a] += pose.by_control_points[a][k]);
            }
        });
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
        Ok(Self { hessian: fit.system.hessian.clone(), coupling, poses: fit.system.poses.clone(), inputs })
    }

    /// Factors from their parts, which must fit each other.
    pub fn from_parts(
        lattice: &Lattice,
        hessian: Vec<f64>,
        coupling: CompressedColumns,
        poses: Vec<Matrix3<f64>>,
        inputs: CompressedColumns,
    ) -> Result<Self, UncertaintyError> {
        let mut matrix = StencilMatrix::zeros(Stencil::of(lattice));
        if matrix.values.len() != hessian.len() {
            return Err(UncertaintyError::Malformed("the Hessian has another lattice's size"));
        }
        matrix.values = hessian;
        if coupling.columns() != 3 * poses.len() || inputs.rows != lattice.len() + 3 * poses.len() {
            return Err(UncertaintyError::Malformed("border and inputs have different numbers of poses"));
        }
        Ok(Self { hessian: matrix, coupling, poses, inputs })
    }

    /// The dense covariance between the given control points (or coefficients), row-major, exact.
    pub fn block(&self, kind: Kind, points: &[usize]) -> Result<Vec<f64>, UncertaintyError> {
        let mut cholesky = Cholesky::analyse(self.hessian.stencil())?;
        let system = self.system();
        let border = Bordered::factorise(&system, &mut cholesky)?;
        let (n, m) = (cholesky.dimension(), points.len());
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
        symmetrise(&mut result, m);
        Ok(result)
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

    /// The factors with the poses eliminated, or `None` where that would take more than `limit` entries.
    pub fn reduced(&self, limit: usize) -> Option<Reduced> {
        let n = self.hessian.stencil().dimension();
        let footprints: Vec<usize> = (0..self.poses.len()).map(|scan| self.coupling.column(3 * scan).count()).collect();
        let scan_of = |column: usize| -> Option<usize> {
            self.inputs.column(column).find(|&(row, _)| row >= n).map(|(row, _)| (row - n) / 3)
        };
        let fill = footprints.iter().map(|f| f * f).sum::<usize>().min(n * n)
            + (0..self.inputs.columns()).filter_map(scan_of).map(|scan| footprints[scan]).sum::<usize>();
        if fill.saturating_add(self.hessian.values.len()) > limit {
            return None;
        }
        let inverse: Vec<Matrix3<f64>> = self.poses.iter().map(|p| p.try_inverse()).collect::<Option<_>>()?;
        let mut hessian = vec![std::collections::BTreeMap::<usize, f64>::new(); n];
        for ((row, column), value) in self.hessian.stencil().entries().zip(&self.hessian.values) {
            hessian[column].insert(row, *value);
            hessian[row].insert(column, *value);
        }
        for (scan, inverse) in inverse.iter().enumerate() {
            let rows = self.scan_coupling(scan);
            for (column, right) in &rows {
                let image = inverse * right;
                for (row, left) in &rows {
                    *hessian[*column].entry(*row).or_default() -= left.dot(&image);
                }
            }
        }
        let mut columns = CompressedColumns::new(n);
        hessian.into_iter().for_each(|column| columns.push(column));
        let mut inputs = CompressedColumns::new(n);
        for column in 0..self.inputs.columns() {
            let mut own: std::collections::BTreeMap<usize, f64> =
                self.inputs.column(column).filter(|&(row, _)| row < n).collect();
            if let Some(scan) = scan_of(column) {
                let mut border = Vector3::zeros();
                self.inputs.column(column).filter(|&(row, _)| row >= n).for_each(|(row, v)| border[(row - n) % 3] = v);
                let image = inverse[scan] * border;
                for (row, left) in self.scan_coupling(scan) {
                    *own.entry(row).or_default() -= left.dot(&image);
                }
            }
            inputs.push(own);
        }
        Some(Reduced { hessian: columns, inputs })
    }

    /// `M` whole, both triangles.
    pub fn bordered_hessian(&self) -> CompressedColumns {
        let n = self.hessian.stencil().dimension();
        let mut columns = vec![std::collections::BTreeMap::<usize, f64>::new(); n + self.coupling.columns()];
        for ((row, column), &value) in self.hessian.stencil().entries().zip(&self.hessian.values) {
            columns[column].insert(row, value);
            columns[row].insert(column, value);
        }
        for k in 0..self.coupling.columns() {
            for (row, value) in self.coupling.column(k) {
                columns[n + k].insert(row, value);
                columns[row].insert(n + k, value);
            }
            for a in 0..3 {
                columns[n + k].insert(n + k - k % 3 + a, self.poses[k / 3][(a, k % 3)]);
            }
        }
        let mut whole = CompressedColumns::new(columns.len());
        columns.into_iter().for_each(|column| whole.push(column));
        whole
    }

    /// A scan's three coupling columns, row by row.
    fn scan_coupling(&self, scan: usize) -> Vec<(usize, Vector3<f64>)> {
        let columns = [0, 1, 2].map(|a| self.coupling.column(3 * scan + a));
        let [x, y, theta] = columns;
        x.zip(y).zip(theta).map(|(((row, x), (_, y)), (_, t))| (row, Vector3::new(x, y, t))).collect()
    }

    fn system(&self) -> System {
        let n = self.hessian.stencil().dimension();
        let mut coupling = Mat::zeros(n, self.coupling.columns());
        for column in 0..self.coupling.columns() {
            self.coupling.column(column).for_each(|(row, value)| coupling[(row, column)] = value);
        }
        let gradient = vec![0.0; n + coupling.ncols()];
        System { gradient, hessian: self.hessian.clone(), coupling, poses: self.poses.clone() }
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
