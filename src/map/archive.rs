//! A map as `.npz` files anyone can open, and back.
//!
//! `map.npz` holds the surface (`sdf`, shape (ny+3, nx+3)), `origin`, `resolution`, both covariances' entries on the
//! stencil (`propagated`, `posterior`: the lower triangle, column by column), the evidence (`evidence`, 4 x 4 marks a
//! cell), the poses and the returns. `factors.npz` holds what any covariance entry can be formed from. The fit's report is
//! JSON inside `map.npz`, as bytes.

use faer::Mat;
use nalgebra::Matrix3;
use thiserror::Error;

use super::npz::{NpzError, NpzReader, NpzWriter};
use super::{FitReport, FittedMap};
use crate::geometry::{Cov3, Pose, Vec2};
use crate::scan::{Evidence, Noise, SUBCELLS};
use crate::sparse::{Stencil, StencilMatrix};
use crate::spline::{Lattice, Surface};
use crate::uncertainty::{CompressedColumns, Factors, Marginals, PoseCovariance, UncertaintyError};

#[derive(Debug, Error)]
pub enum ArchiveError {
    #[error(transparent)]
    Npz(#[from] NpzError),
    #[error("the map's file is damaged: {0}")]
    Damaged(&'static str),
    #[error("the map's report is damaged: {0}")]
    Report(#[from] serde_json::Error),
    #[error(transparent)]
    Factors(#[from] UncertaintyError),
}

/// No array of a map is larger than this, unpacked.
const LARGEST_ARRAY: u64 = 8 << 30;

impl FittedMap {
    /// The map as `map.npz`.
    pub fn to_npz(&self) -> Result<Vec<u8>, ArchiveError> {
        let lattice = self.lattice();
        let [nx, ny] = lattice.control_points();
        let poses: Vec<f64> = self.poses.iter().flat_map(|p| [p.x, p.y, p.theta]).collect();
        let returns: Vec<f64> = self.returns.iter().flat_map(|p| [p.x, p.y]).collect();
        let noise = self.noise;
        let cells = lattice.cells.map(|n| n as i64);
        let report = serde_json::to_vec(&self.report)?;
        let mut npz = NpzWriter::default();
        npz.array("sdf", &[ny, nx], &self.surface.coefficients)?
            .array("origin", &[2], &lattice.origin)?
            .array("resolution", &[], &[lattice.resolution])?
            .array("cells", &[2], &cells)?
            .array("propagated", &[self.marginals.propagated.values.len()], &self.marginals.propagated.values)?
            .array("posterior", &[self.marginals.posterior.values.len()], &self.marginals.posterior.values)?
            .array("evidence", &[ny.saturating_sub(3) * SUBCELLS, (nx - 3) * SUBCELLS], self.evidence.marks())?
            .array("poses", &[self.poses.len(), 3], &poses)?
            .array("returns", &[self.returns.len(), 2], &returns)?
            .array("noise", &[4], &[noise.sigma_x, noise.sigma_y, noise.sigma_theta, noise.sigma_range])?;
        for (name, covariances) in pose_covariances(&self.pose_covariance) {
            let flat: Vec<f64> =
                covariances.iter().flat_map(|c| c.transpose().iter().copied().collect::<Vec<_>>()).collect();
            npz.array(name, &[covariances.len(), 3, 3], &flat)?;
        }
        npz.array("report", &[report.len()], &report)?;
        Ok(npz.finish()?)
    }

    /// A map from its `map.npz`.
    pub fn from_npz(bytes: &[u8]) -> Result<Self, ArchiveError> {
        let mut npz = NpzReader::new(bytes, LARGEST_ARRAY)?;
        let lattice = read_lattice(&mut npz)?;
        let coefficients: Vec<f64> = npz.array("sdf")?;
        if coefficients.len() != lattice.len() {
            return Err(ArchiveError::Damaged("the coefficients do not fit the lattice"));
        }
        let stencil = Stencil::of(&lattice);
        let mut covariance = |name: &str| -> Result<StencilMatrix, ArchiveError> {
            let mut matrix = StencilMatrix::zeros(stencil.clone());
            let values: Vec<f64> = npz.array(name)?;
            if values.len() != matrix.values.len() {
                return Err(ArchiveError::Damaged("a covariance does not fit the lattice"));
            }
            matrix.values = values;
            Ok(matrix)
        };
        let marginals = Marginals { propagated: covariance("propagated")?, posterior: covariance("posterior")? };
        let evidence = Evidence::from_marks(&lattice, npz.array("evidence")?)
            .ok_or(ArchiveError::Damaged("the evidence does not fit the lattice"))?;
        let noise: Vec<f64> = npz.array("noise")?;
        let [sigma_x, sigma_y, sigma_theta, sigma_range] = noise[..] else {
            return Err(ArchiveError::Damaged("noise has four entries"));
        };
        let triples: Vec<f64> = npz.array("poses")?;
        let pairs: Vec<f64> = npz.array("returns")?;
        let pose_covariance = PoseCovariance {
            propagated: read_covariances(&mut npz, "pose_propagated")?,
            posterior: read_covariances(&mut npz, "pose_posterior")?,
        };
        let report: FitReport = serde_json::from_slice(&npz.array::<u8>("report")?)?;
        Ok(Self {
            surface: Surface { lattice, coefficients },
            evidence,
            marginals,
            report,
            poses: triples.chunks_exact(3).map(|p| Pose::new(p[0], p[1], p[2])).collect(),
            pose_covariance,
            returns: pairs.chunks_exact(2).map(|p| Vec2::new(p[0], p[1])).collect(),
            noise: Noise { sigma_x, sigma_y, sigma_theta, sigma_range },
        })
    }
}

/// The factors as `factors.npz`: the bordered form, as they are stored.
pub fn factors_to_npz(lattice: &Lattice, factors: &Factors) -> Result<Vec<u8>, ArchiveError> {
    let poses: Vec<f64> =
        factors.poses.iter().flat_map(|block| block.transpose().iter().copied().collect::<Vec<_>>()).collect();
    let mut npz = NpzWriter::default();
    npz.array("origin", &[2], &lattice.origin)?
        .array("resolution", &[], &[lattice.resolution])?
        .array("cells", &[2], &lattice.cells.map(|n| n as i64))?
        .array("hessian", &[factors.hessian.values.len()], &factors.hessian.values)?
        .array("poses", &[factors.poses.len(), 3, 3], &poses)?;
    let [rows, modes] = [factors.gauge.nrows(), factors.gauge.ncols()];
    let gauge: Vec<f64> = (0..rows * modes).map(|k| factors.gauge[(k / modes, k % modes)]).collect();
    npz.array("gauge", &[rows, modes], &gauge)?;
    write_columns(&mut npz, "coupling", &factors.coupling)?;
    write_columns(&mut npz, "input", &factors.inputs)?;
    Ok(npz.finish()?)
}

/// Factors from their `factors.npz`.
pub fn factors_from_npz(bytes: &[u8]) -> Result<Factors, ArchiveError> {
    let mut npz = NpzReader::new(bytes, LARGEST_ARRAY)?;
    let lattice = read_lattice(&mut npz)?;
    let hessian = npz.array("hessian")?;
    let poses = read_covariances(&mut npz, "poses")?;
    let coupling = read_columns(&mut npz, "coupling")?;
    let inputs = read_columns(&mut npz, "input")?;
    let flat: Vec<f64> = npz.array("gauge")?;
    let modes = if flat.is_empty() { 0 } else { flat.len() / (3 * poses.len()).max(1) };
    let gauge = Mat::from_fn(3 * poses.len(), modes, |row, mode| flat[row * modes + mode]);
    Ok(Factors::from_parts(&lattice, hessian, coupling, poses, gauge, inputs)?)
}

/// Writes the four arrays of a CSC matrix: `NAME_data`, `NAME_indices`, `NAME_indptr`, `NAME_shape`.
pub fn write_columns(npz: &mut NpzWriter, name: &str, columns: &CompressedColumns) -> Result<(), NpzError> {
    let signed = |values: &[usize]| values.iter().map(|&v| v as i64).collect::<Vec<_>>();
    npz.array(&format!("{name}_data"), &[columns.values.len()], &columns.values)?
        .array(&format!("{name}_indices"), &[columns.indices.len()], &signed(&columns.indices))?
        .array(&format!("{name}_indptr"), &[columns.starts.len()], &signed(&columns.starts))?
        .array(&format!("{name}_shape"), &[2], &signed(&[columns.rows, columns.columns()]))?;
    Ok(())
}

/// Arrays of one number a control point, with the lattice's `origin` and `resolution`.
pub fn on_lattice_npz(lattice: &Lattice, arrays: &[(&str, &[f64])]) -> Result<Vec<u8>, NpzError> {
    let [nx, ny] = lattice.control_points();
    let mut npz = NpzWriter::default();
    for (name, values) in arrays {
        npz.array(name, &[ny, nx], values)?;
    }
    npz.array("origin", &[2], &lattice.origin)?.array("resolution", &[], &[lattice.resolution])?;
    npz.finish()
}

/// Both triangles in CSC, as `scipy.sparse.save_npz` writes it.
pub fn scipy_sparse(matrix: &StencilMatrix) -> Result<Vec<u8>, NpzError> {
    let columns = whole(matrix);
    let narrow = |values: &[usize]| values.iter().map(|&v| v as i32).collect::<Vec<_>>();
    let mut npz = NpzWriter::default();
    npz.array("indices", &[columns.indices.len()], &narrow(&columns.indices))?
        .array("indptr", &[columns.starts.len()], &narrow(&columns.starts))?
        .bytes("format", "csc")?
        .array("shape", &[2], &[columns.rows as i64, columns.columns() as i64])?
        .array("data", &[columns.values.len()], &columns.values)?;
    npz.finish()
}

fn whole(matrix: &StencilMatrix) -> CompressedColumns {
    let n = matrix.stencil().dimension();
    let mut columns = vec![Vec::with_capacity(49); n];
    for ((row, column), &value) in matrix.stencil().entries().zip(&matrix.values) {
        columns[column].push((row, value));
        if row != column {
            columns[row].push((column, value));
        }
    }
    let mut whole = CompressedColumns::new(n);
    for mut column in columns {
        column.sort_unstable_by_key(|&(row, _)| row);
        whole.push(column);
    }
    whole
}

fn read_columns(npz: &mut NpzReader<'_>, name: &str) -> Result<CompressedColumns, ArchiveError> {
    let mut indices = |part: &str| -> Result<Vec<usize>, ArchiveError> {
        let values: Vec<i64> = npz.array(&format!("{name}_{part}"))?;
        let unsigned = values.into_iter().map(usize::try_from).collect::<Result<_, _>>();
        unsigned.map_err(|_| ArchiveError::Damaged("an index is negative"))
    };
    let (rows, starts, shape) = (indices("indices")?, indices("indptr")?, indices("shape")?);
    let values: Vec<f64> = npz.array(&format!("{name}_data"))?;
    let fits = shape.len() == 2
        && starts.len() == shape[1] + 1
        && starts.windows(2).all(|pair| pair[0] <= pair[1])
        && starts.last() == Some(&values.len())
        && rows.len() == values.len()
        && rows.iter().all(|&row| row < shape[0]);
    if !fits {
        return Err(ArchiveError::Damaged("a sparse matrix is not one"));
    }
    Ok(CompressedColumns { rows: shape[0], starts, indices: rows, values })
}

fn read_lattice(npz: &mut NpzReader<'_>) -> Result<Lattice, ArchiveError> {
    let (origin, cells) = (npz.array::<f64>("origin")?, npz.array::<i64>("cells")?);
    let resolution = npz.array::<f64>("resolution")?;
    match (&origin[..], &cells[..], &resolution[..]) {
        (&[x, y], &[nx, ny], &[resolution]) if (1..1 << 31).contains(&nx) && (1..1 << 31).contains(&ny) => {
            Ok(Lattice { origin: [x, y], resolution, cells: [nx as usize, ny as usize] })
        }
        _ => Err(ArchiveError::Damaged("the lattice has the wrong shape")),
    }
}

fn pose_covariances(poses: &PoseCovariance) -> [(&'static str, &[Cov3]); 2] {
    [("pose_propagated", &poses.propagated), ("pose_posterior", &poses.posterior)]
}

fn read_covariances(npz: &mut NpzReader<'_>, name: &str) -> Result<Vec<Matrix3<f64>>, ArchiveError> {
    let flat: Vec<f64> = npz.array(name)?;
    Ok(flat.chunks_exact(9).map(Matrix3::from_row_slice).collect())
}
