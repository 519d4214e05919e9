//! A map as `.npz` files anyone can open, and back.
//!
//! `map.npz` holds the surfaces (`sdf`, or `vdf_x` and `vdf_y`, of shape (ny+3, nx+3); NaN where a control point is not
//! in use), `origin`, `resolution`, both covariances' entries on the stencil (`propagated`, `posterior`: the lower
//! triangle, column by column; of a vector field with `_xx`, `_xy`, `_yx`, `_yy`), the evidence (`evidence`, 4 x 4
//! marks a cell), the surfaces (`facets`: the two ends of each, `facet_sigma`: propagated and posterior,
//! `facet_open`), the poses and the returns; of joined maps their `frames`. Covariances off the diagonal are f32: a millionth of a sigma is enough. What any other
//! entry can be formed from is found again from the job's request and `resume` ([`crate::fit::resume`]). The fit's
//! report is JSON inside `map.npz`, as bytes.

use nalgebra::Matrix3;
use thiserror::Error;

use super::clearance::Clearance;
use super::field::CellCovariance;
use super::npz::{NpzError, NpzReader, NpzWriter};
use super::{Chart, Facet, Field, FitReport, FittedMap, Frame, MapError, Surfaces, zero_lines};
use crate::geometry::{Cov3, Pose, Vec2};
use crate::scan::{Evidence, Noise, SUBCELLS};
use crate::sparse::{Stencil, StencilMatrix};
use crate::spline::{Lattice, Surface};
use crate::uncertainty::{CompressedColumns, ExportedFactors, Factors, Kind, PoseCovariance};

#[derive(Debug, Error)]
pub enum ArchiveError {
    #[error(transparent)]
    Npz(#[from] NpzError),
    #[error("the map's file is damaged: {0}")]
    Damaged(&'static str),
    #[error("the map's report is damaged: {0}")]
    Report(#[from] serde_json::Error),
    #[error("the map's file has format {0}, which this version does not know")]
    Format(i64),
    #[error(transparent)]
    Map(#[from] MapError),
}

/// The version of the file's layout. In the first, which has no `format`, covariances are f64 and hold control points
/// that are not in use, and surfaces are not kept.
const FORMAT: i64 = 2;

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
        npz.array("format", &[], &[FORMAT])?;
        npz.array("resume", &[self.resume.len()], &self.resume)?;
        write_covariances(&mut npz, &self.field)?;
        for (name, covariances) in pose_covariances(&self.pose_covariance) {
            let flat: Vec<f64> =
                covariances.iter().flat_map(|c| c.transpose().iter().copied().collect::<Vec<_>>()).collect();
            npz.array(name, &[covariances.len(), 3, 3], &flat)?;
        }
        if !self.frames.is_empty() {
            let rows: Vec<f64> = self.frames.iter().flat_map(frame_row).collect();
            npz.array("frames", &[self.frames.len(), FRAME_ROW], &rows)?;
        }
        write_surfaces(&mut npz, &self.surfaces, ["facets", "facet_sigma", "facet_open"])?;
        npz.array("report", &[report.len()], &report)?;
        Ok(npz.finish()?)
    }

    /// A map from its `map.npz`.
    pub fn from_npz(bytes: &[u8]) -> Result<Self, ArchiveError> {
        let mut npz = NpzReader::new(bytes, LARGEST_ARRAY)?;
        let lattice = read_lattice(&mut npz)?;
        let format = if npz.has("format") { npz.array::<i64>("format")?.first().copied().unwrap_or(0) } else { 1 };
        if !(1..=FORMAT).contains(&format) {
            return Err(ArchiveError::Format(format));
        }
        let field = read_field(&mut npz, &lattice, format)?;
        let resume = if npz.has("resume") { npz.array("resume")? } else { Vec::new() };
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
        let frames = read_frames(&mut npz)?;
        let report: FitReport = serde_json::from_slice(&npz.array::<u8>("report")?)?;
        let surfaces = match npz.has("facets") {
            true => read_surfaces(&mut npz, &lattice)?,
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
            poses: poses_of(&triples),
            pose_covariance,
            returns: pairs.chunks_exact(2).map(|p| Vec2::new(p[0], p[1])).collect(),
            noise: Noise { sigma_x, sigma_y, sigma_theta, sigma_range },
            frames,
            resume,
        })
    }
}

/// A frame's row: its index, its motion, where it was put, the motion's covariance.
const FRAME_ROW: usize = 16;

fn frame_row(frame: &Frame) -> [f64; FRAME_ROW] {
    let (m, p) = (&frame.motion, &frame.put);
    let head = [frame.index as f64, m.x, m.y, m.theta, p.x, p.y, p.theta];
    std::array::from_fn(|k| if k < 7 { head[k] } else { frame.covariance[((k - 7) / 3, (k - 7) % 3)] })
}

fn read_frames(npz: &mut NpzReader<'_>) -> Result<Vec<Frame>, ArchiveError> {
    let rows: Vec<f64> = if npz.has("frames") { npz.array("frames")? } else { Vec::new() };
    let frame = |row: &[f64]| Frame {
        index: row[0] as usize,
        motion: Pose::new(row[1], row[2], row[3]),
        put: Pose::new(row[4], row[5], row[6]),
        covariance: Cov3::from_row_slice(&row[7..]),
    };
    Ok(rows.chunks_exact(FRAME_ROW).map(frame).collect())
}

fn poses_of(triples: &[f64]) -> Vec<Pose> {
    triples.chunks_exact(3).map(|p| Pose::new(p[0], p[1], p[2])).collect()
}

fn write_surfaces(npz: &mut NpzWriter, surfaces: &Surfaces, names: [&str; 3]) -> Result<(), NpzError> {
    let facets = surfaces.facets();
    let ends: Vec<f64> = facets.iter().flat_map(|f| f.ends.map(|p| [p.x, p.y])).flatten().collect();
    let sigma: Vec<f64> = facets.iter().flat_map(|f| f.sigma).collect();
    let open: Vec<bool> = facets.iter().flat_map(|f| f.open).collect();
    npz.array(names[0], &[facets.len(), 2, 2], &ends)?.array(names[1], &[facets.len(), 2], &sigma)?.array(
        names[2],
        &[facets.len(), 2],
        &open,
    )?;
    Ok(())
}

fn read_surfaces(npz: &mut NpzReader<'_>, lattice: &Lattice) -> Result<Surfaces, ArchiveError> {
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
    Ok(Surfaces::new(facets.map(facet).collect(), lattice))
}

/// The parts of a covariance by name, in the order of [`CellCovariance::parts`].
fn part_names(kind: Kind, parts: usize) -> Vec<String> {
    let kind = if kind == Kind::Propagated { "propagated" } else { "posterior" };
    match parts {
        1 => vec![kind.into()],
        _ => ["xx", "xy", "yx", "yy"].map(|part| format!("{kind}_{part}")).into(),
    }
}

fn write_covariances(npz: &mut NpzWriter, field: &Field) -> Result<(), NpzError> {
    for kind in Kind::ALL {
        let own = &field.covariance(kind).parts;
        for (name, part) in part_names(kind, own.len()).iter().zip(own) {
            let stencil = part.stencil();
            let stored: Vec<f32> = in_use(stencil).map(|at| part.values[at] as f32).collect();
            let diagonal = part.diagonal();
            let diagonal: Vec<f64> =
                (0..diagonal.len()).filter(|k| stencil.is_active(*k)).map(|k| diagonal[k]).collect();
            npz.array(name, &[stored.len()], &stored)?;
            npz.array(&format!("{name}_diagonal"), &[diagonal.len()], &diagonal)?;
        }
    }
    Ok(())
}

/// The stencil's entries between control points in use.
fn in_use(stencil: &Stencil) -> impl Iterator<Item = usize> + '_ {
    stencil.entries().enumerate().filter(|(_, (row, _))| stencil.is_active(*row)).map(|(at, _)| at)
}

fn read_field(npz: &mut NpzReader<'_>, lattice: &Lattice, format: i64) -> Result<Field, ArchiveError> {
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
    let places: Vec<usize> = if format == 1 { (0..stencil.len()).collect() } else { in_use(&stencil).collect() };
    let mut part = |name: &String| -> Result<StencilMatrix, ArchiveError> {
        let values: Vec<f64> = match format {
            1 => npz.array(name)?,
            _ => npz.array::<f32>(name)?.into_iter().map(f64::from).collect(),
        };
        if values.len() != places.len() {
            return Err(ArchiveError::Damaged("a covariance does not fit the lattice"));
        }
        let mut matrix = StencilMatrix::zeros(stencil.clone());
        places.iter().zip(values).for_each(|(&at, value)| matrix.values[at] = value);
        if format > 1 {
            let exact: Vec<f64> = npz.array(&format!("{name}_diagonal"))?;
            let mut diagonal = matrix.diagonal();
            let places = (0..diagonal.len()).filter(|k| stencil.is_active(*k)).collect::<Vec<_>>();
            places.iter().zip(exact).for_each(|(&k, value)| diagonal[k] = value);
            matrix.set_diagonal(&diagonal);
        }
        Ok(matrix)
    };
    let parts = surfaces.len() * surfaces.len();
    let mut covariance = |kind| -> Result<CellCovariance, ArchiveError> {
        Ok(CellCovariance { parts: part_names(kind, parts).iter().map(&mut part).collect::<Result<_, _>>()? })
    };
    Ok(Field::new(surfaces, [covariance(Kind::Propagated)?, covariance(Kind::Posterior)?]))
}

/// Writes the four arrays of a CSC matrix: `NAME_data`, `NAME_indices`, `NAME_indptr`, `NAME_shape`.
fn write_columns(npz: &mut NpzWriter, name: &str, columns: &CompressedColumns) -> Result<(), NpzError> {
    let signed = |values: &[usize]| values.iter().map(|&v| v as i64).collect::<Vec<_>>();
    npz.array(&format!("{name}_data"), &[columns.values.len()], &columns.values)?
        .array(&format!("{name}_indices"), &[columns.indices.len()], &signed(&columns.indices))?
        .array(&format!("{name}_indptr"), &[columns.starts.len()], &signed(&columns.starts))?
        .array(&format!("{name}_shape"), &[2], &signed(&[columns.rows, columns.columns()]))?;
    Ok(())
}

/// Entries of eliminated factors at most; larger maps get the bordered form.
const LARGEST_REDUCED: usize = 12_000_000;

/// Hessian and inputs on the control points alone, or, where that would be too much, bordered: control points first,
/// then `pose_unknowns` more: the poses', and three of their common motion.
pub fn factors_npz(factors: &Factors) -> Result<Vec<u8>, NpzError> {
    let ExportedFactors { hessian, inputs } = factors.exported(LARGEST_REDUCED);
    let mut npz = NpzWriter::default();
    write_columns(&mut npz, "hessian", &hessian)?;
    write_columns(&mut npz, "input", &inputs)?;
    npz.array("pose_unknowns", &[], &[(hessian.rows - factors.coefficients()) as i64])?;
    npz.finish()
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

/// What a client needs to measure distances itself: a map's facets (`ends`, `sigma`: propagated and posterior, `open`)
/// and where there is evidence (`observed`: not 0 where a beam passed or a surface was met, 4 x 4 marks a cell, lowest y
/// first), with the lattice's `origin` and `resolution`.
pub fn surfaces_npz(map: &FittedMap) -> Result<Vec<u8>, NpzError> {
    let [width, height] = map.evidence.size();
    let mut npz = NpzWriter::default();
    write_surfaces(&mut npz, &map.surfaces, ["ends", "sigma", "open"])?;
    let lattice = map.lattice();
    npz.array("observed", &[height, width], map.evidence.marks())?.array("origin", &[2], &lattice.origin)?.array(
        "resolution",
        &[],
        &[lattice.resolution],
    )?;
    npz.finish()
}

/// A field's covariance between control points that share a cell, both triangles in CSC, as `scipy.sparse.save_npz`
/// writes it. A vector field's has the x coefficients before the y coefficients.
pub fn scipy_sparse(field: &Field, kind: Kind) -> Result<Vec<u8>, NpzError> {
    let n = field.lattice().len();
    let own = &field.covariance(kind).parts;
    let mut columns = CompressedColumns::new(own.len().isqrt() * n);
    match own.as_slice() {
        [xx, xy, yx, yy] => {
            push_columns(&mut columns, n, [(xx, xx), (yx, xy)]);
            push_columns(&mut columns, n, [(xy, yx), (yy, yy)]);
        }
        parts => parts.iter().for_each(|own| push_columns(&mut columns, n, [(own, own)])),
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
