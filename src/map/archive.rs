//! A map as `.npz` files anyone can open, and back.
//!
//! `map.npz` holds the surfaces (`sdf`, or `vdf_x` and `vdf_y`, of shape (ny+3, nx+3); NaN where a control point is not
//! in use), `origin`, `resolution`, both covariances' entries on the stencil (`propagated`, `posterior`: the lower
//! triangle, column by column; of a vector field with `_xx`, `_xy`, `_yx`, `_yy`), the evidence (`evidence`, 4 x 4
//! marks a cell), the surfaces (`facets`: the two ends of each, `facet_sigma`: propagated and posterior,
//! `facet_open`), the poses and the returns. `factors.npz` holds what any covariance entry can be formed from. The
//! fit's report is JSON inside `map.npz`, as bytes.

use faer::Mat;
use nalgebra::Matrix3;
use thiserror::Error;

use super::npz::{NpzError, NpzReader, NpzWriter};
use super::clearance::Clearance;
use super::{Chart, Facet, Field, FitReport, FittedMap, MapError, Surfaces, zero_lines};
use crate::geometry::{Cov3, Pose, Vec2};
use crate::scan::{Evidence, Noise, SUBCELLS};
use crate::sparse::{Stencil, StencilMatrix};
use crate::spline::{Lattice, Surface};
use crate::uncertainty::{
    CompressedColumns, Factors, Kind, Marginals, PoseCovariance, UncertaintyError, VectorCovariance, VectorMarginals,
};

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
    #[error(transparent)]
    Map(#[from] MapError),
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
        for (name, coefficients) in self.field.coefficients() {
            npz.array(name, &[ny, nx], coefficients)?;
        }
        npz.array("origin", &[2], &lattice.origin)?
            .array("resolution", &[], &[lattice.resolution])?
            .array("cells", &[2], &cells)?
            .array("evidence", &[ny.saturating_sub(3) * SUBCELLS, (nx - 3) * SUBCELLS], self.evidence.marks())?
            .array("poses", &[self.poses.len(), 3], &poses)?
            .array("returns", &[self.returns.len(), 2], &returns)?
            .array("noise", &[4], &[noise.sigma_x, noise.sigma_y, noise.sigma_theta, noise.sigma_range])?;
        for (name, matrix) in covariances(&self.field) {
            npz.array(&name, &[matrix.values.len()], &matrix.values)?;
        }
        for (name, covariances) in pose_covariances(&self.pose_covariance) {
            let flat: Vec<f64> =
                covariances.iter().flat_map(|c| c.transpose().iter().copied().collect::<Vec<_>>()).collect();
            npz.array(name, &[covariances.len(), 3, 3], &flat)?;
        }
        write_surfaces(&mut npz, &self.surfaces)?;
        npz.array("report", &[report.len()], &report)?;
        Ok(npz.finish()?)
    }

    /// A map from its `map.npz`.
    pub fn from_npz(bytes: &[u8]) -> Result<Self, ArchiveError> {
        let mut npz = NpzReader::new(bytes, LARGEST_ARRAY)?;
        let lattice = read_lattice(&mut npz)?;
        let field = read_field(&mut npz, &lattice)?;
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
        let surfaces = match npz.has("facets") {
            true => read_surfaces(&mut npz, lattice.resolution)?,
            false => {
                let lines = zero_lines(Chart { field: &field, evidence: &evidence }).map_err(MapError::from)?;
                Surfaces::of_lines(&field, &lines)
            }
        };
        Ok(Self {
            field,
            evidence,
            surfaces,
            clearance: Clearance::default(),
            report,
            poses: triples.chunks_exact(3).map(|p| Pose::new(p[0], p[1], p[2])).collect(),
            pose_covariance,
            returns: pairs.chunks_exact(2).map(|p| Vec2::new(p[0], p[1])).collect(),
            noise: Noise { sigma_x, sigma_y, sigma_theta, sigma_range },
        })
    }
}

fn write_surfaces(npz: &mut NpzWriter, surfaces: &Surfaces) -> Result<(), NpzError> {
    let facets = surfaces.facets();
    let ends: Vec<f64> = facets.iter().flat_map(|f| f.ends.map(|p| [p.x, p.y])).flatten().collect();
    let sigma: Vec<f64> = facets.iter().flat_map(|f| f.sigma).collect();
    let open: Vec<bool> = facets.iter().flat_map(|f| f.open).collect();
    npz.array("facets", &[facets.len(), 2, 2], &ends)?
        .array("facet_sigma", &[facets.len(), 2], &sigma)?
        .array("facet_open", &[facets.len(), 2], &open)?;
    Ok(())
}

fn read_surfaces(npz: &mut NpzReader<'_>, resolution: f64) -> Result<Surfaces, ArchiveError> {
    let ends: Vec<f64> = npz.array("facets")?;
    let sigma: Vec<f64> = npz.array("facet_sigma")?;
    let open: Vec<bool> = npz.array("facet_open")?;
    if ends.len() != 2 * sigma.len() || sigma.len() != open.len() {
        return Err(ArchiveError::Damaged("the facets' arrays have different lengths"));
    }
    let facets = ends.chunks_exact(4).zip(sigma.chunks_exact(2)).zip(open.chunks_exact(2));
    let facet = |((ends, sigma), open): ((&[f64], &[f64]), &[bool])| Facet {
        ends: [Vec2::new(ends[0], ends[1]), Vec2::new(ends[2], ends[3])],
        sigma: [sigma[0], sigma[1]],
        open: [open[0], open[1]],
    };
    Ok(Surfaces::new(facets.map(facet).collect(), resolution))
}

fn covariances(field: &Field) -> Vec<(String, &StencilMatrix)> {
    match field {
        Field::Signed { marginals, .. } => {
            vec![("propagated".into(), &marginals.propagated), ("posterior".into(), &marginals.posterior)]
        }
        Field::Vector { marginals, .. } => [("propagated", &marginals.propagated), ("posterior", &marginals.posterior)]
            .into_iter()
            .flat_map(|(kind, own)| {
                PARTS.into_iter().zip(own.parts()).map(move |(part, m)| (format!("{kind}_{part}"), m))
            })
            .collect(),
    }
}

/// The parts of a vector field's covariance, in the order of [`VectorCovariance::parts`].
const PARTS: [&str; 4] = ["xx", "xy", "yx", "yy"];

fn read_field(npz: &mut NpzReader<'_>, lattice: &Lattice) -> Result<Field, ArchiveError> {
    let names: &[&str] = if npz.has("sdf") { &["sdf"] } else { &["vdf_x", "vdf_y"] };
    let mut surfaces = Vec::new();
    for name in names {
        let coefficients: Vec<f64> = npz.array(name)?;
        if coefficients.len() != lattice.len() {
            return Err(ArchiveError::Damaged("the coefficients do not fit the lattice"));
        }
        surfaces.push(Surface { lattice: lattice.clone(), coefficients });
    }
    let active: Vec<bool> = surfaces[0].coefficients.iter().map(|c| c.is_finite()).collect();
    let stencil = if active.contains(&false) { Stencil::over(lattice, active) } else { Stencil::of(lattice) };
    let mut covariance = |name: &str| -> Result<StencilMatrix, ArchiveError> {
        let mut matrix = StencilMatrix::zeros(stencil.clone());
        let values: Vec<f64> = npz.array(name)?;
        if values.len() != matrix.values.len() {
            return Err(ArchiveError::Damaged("a covariance does not fit the lattice"));
        }
        matrix.values = values;
        Ok(matrix)
    };
    let mut vector = |kind: &str| -> Result<VectorCovariance, ArchiveError> {
        let [xx, xy, yx, yy] = PARTS.map(|part| covariance(&format!("{kind}_{part}")));
        Ok(VectorCovariance { xx: xx?, xy: xy?, yx: yx?, yy: yy? })
    };
    Ok(match <[Surface; 2]>::try_from(surfaces) {
        Ok(components) => {
            let marginals = VectorMarginals { propagated: vector("propagated")?, posterior: vector("posterior")? };
            Field::Vector { components, marginals: Box::new(marginals) }
        }
        Err(mut one) => {
            let marginals = Marginals { propagated: covariance("propagated")?, posterior: covariance("posterior")? };
            Field::Signed { surface: one.remove(0), marginals }
        }
    })
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
    let stencil = factors.hessian.stencil();
    let active: Vec<u8> = (0..lattice.len()).map(|point| u8::from(stencil.is_active(point))).collect();
    if active.contains(&0) {
        npz.array("active", &[active.len()], &active)?;
    }
    let [rows, modes] = [factors.gauge.nrows(), factors.gauge.ncols()];
    let gauge: Vec<f64> = (0..rows * modes).map(|k| factors.gauge[(k / modes, k % modes)]).collect();
    npz.array("gauge", &[rows, modes], &gauge)?;
    write_columns(&mut npz, "coupling", &factors.coupling)?;
    write_columns(&mut npz, "input", &factors.inputs)?;
    if let Some(apart) = &factors.apart {
        npz.array("apart_hessian", &[apart.hessian.values.len()], &apart.hessian.values)?;
        write_columns(&mut npz, "apart_input", &apart.inputs)?;
    }
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
    let stencil = if npz.has("active") {
        let active: Vec<u8> = npz.array("active")?;
        if active.len() != lattice.len() {
            return Err(ArchiveError::Damaged("the active control points do not fit the lattice"));
        }
        Stencil::over(&lattice, active.into_iter().map(|mark| mark != 0).collect())
    } else {
        Stencil::of(&lattice)
    };
    let apart = match npz.has("apart_hessian") {
        true => {
            let (hessian, inputs) = (npz.array("apart_hessian")?, read_columns(&mut npz, "apart_input")?);
            let none = CompressedColumns::new(lattice.len());
            let own = Factors::from_parts(stencil.clone(), hessian, none, Vec::new(), Mat::zeros(0, 0), inputs)?;
            Some(Box::new(own))
        }
        false => None,
    };
    Ok(Factors { apart, ..Factors::from_parts(stencil, hessian, coupling, poses, gauge, inputs)? })
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

/// A field's covariance between control points that share a cell, both triangles in CSC, as `scipy.sparse.save_npz`
/// writes it. A vector field's has the x coefficients before the y coefficients.
pub fn scipy_sparse(field: &Field, kind: Kind) -> Result<Vec<u8>, NpzError> {
    let n = field.lattice().len();
    let mut columns = CompressedColumns::new(match field {
        Field::Signed { .. } => n,
        Field::Vector { .. } => 2 * n,
    });
    match field {
        Field::Signed { marginals, .. } => {
            let own = marginals.of(kind);
            push_columns(&mut columns, n, [(own, own)]);
        }
        Field::Vector { marginals, .. } => {
            let own = marginals.of(kind);
            push_columns(&mut columns, n, [(&own.xx, &own.xx), (&own.yx, &own.xy)]);
            push_columns(&mut columns, n, [(&own.xy, &own.yx), (&own.yy, &own.yy)]);
        }
    }
    let narrow = |values: &[usize]| values.iter().map(|&v| v as i32).collect::<Vec<_>>();
    let mut npz = NpzWriter::default();
    npz.array("indices", &[columns.indices.len()], &narrow(&columns.indices))?
        .array("indptr", &[columns.starts.len()], &narrow(&columns.starts))?
        .bytes("format", "csc")?
        .array("shape", &[2], &[columns.rows as i64, columns.columns() as i64])?
        .array("data", &[columns.values.len()], &columns.values)?;
    npz.finish()
}

/// Appends the columns of blocks that lie one below the other, `n` rows each: of every block what holds its lower
/// triangle, and what holds its upper one, transposed. Control points that are not in use have no entries.
fn push_columns<const K: usize>(into: &mut CompressedColumns, n: usize, blocks: [(&StencilMatrix, &StencilMatrix); K]) {
    let stencil = blocks[0].0.stencil();
    let mut columns = vec![Vec::with_capacity(49 * K); n];
    for (k, (lower, upper)) in blocks.into_iter().enumerate() {
        for (position, (row, column)) in stencil.entries().enumerate() {
            if stencil.is_active(row) {
                columns[column].push((k * n + row, lower.values[position]));
                if row != column {
                    columns[row].push((k * n + column, upper.values[position]));
                }
            }
        }
    }
    for mut column in columns {
        column.sort_unstable_by_key(|&(row, _)| row);
        into.push(column);
    }
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
