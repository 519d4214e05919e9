//! The covariance of a vector field: of both components, and between them.
//!
//! The components `a, b` share one Hessian `H`, but not their inputs. Ranges move the surface along its normal `n`,
//! scan by scan and surfel by surfel. What the spline cannot follow moves it cell by cell, since that is the scale on
//! which a spline errs, by `model_sigma` or by as much as the cell's surfels were missed, where noise alone does not
//! explain that (the cluster-robust "sandwich" of Huber and White): `G_ab = sum over these inputs n_a n_b b b^T`. A
//! pose moves everything its scan saw. With the stacked `K`, `W = H^-1 K` and the other letters of
//! [`super::marginals`],
//!
//! ```text
//! fixed poses     posterior   2 H^-1 [a = b]
//!                 propagated  H^-1 G_ab H^-1 + F_a F_b^T
//! refined poses   posterior   2 (H^-1 [a = b] + W_a S^-1 W_b^T) + W_a U U^T W_b^T
//!                 propagated  H^-1 G_ab H^-1 - Y_a W_b^T - W_a Y_b^T + W_a Q W_b^T
//! ```
//!
//! Surfels and characteristics are taken as they are: what noise does to *them* is of second order and left out.

use std::collections::BTreeMap;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::{Matrix3, Vector3};

use super::inputs::CompressedColumns;
use super::marginals::{PoseCovariance, SCANS_A_BLOCK, pose_image, poses_in_world, stencil_times};
use super::{Factors, Kind, UncertaintyError};
use crate::fit::{Bordered, Poses, Surfel, VectorFit, solve_components};
use crate::geometry::Vec2;
use crate::sparse::{CellBlock, StencilMatrix, selected_sandwich};
use crate::spline::{SUPPORT, dot, gather};

/// Numbers that pose columns take at most at a time.
const LARGEST_COLUMNS: usize = 2_000_000;

/// One covariance of a vector field on the stencil, square metres. Entry (row, column) of `xy` is between the x
/// coefficient of the row's control point and the y coefficient of the column's, for rows no lower than columns.
#[derive(Debug, Clone)]
pub struct VectorCovariance {
    pub xx: StencilMatrix,
    pub xy: StencilMatrix,
    pub yx: StencilMatrix,
    pub yy: StencilMatrix,
}

/// Both covariances of a vector field.
#[derive(Debug, Clone)]
pub struct VectorMarginals {
    pub propagated: VectorCovariance,
    pub posterior: VectorCovariance,
}

impl VectorMarginals {
    pub fn of(&self, kind: Kind) -> &VectorCovariance {
        match kind {
            Kind::Propagated => &self.propagated,
            Kind::Posterior => &self.posterior,
        }
    }
}

impl VectorCovariance {
    /// The parts in the order xx, xy, yx, yy.
    pub fn parts(&self) -> [&StencilMatrix; 4] {
        [&self.xx, &self.xy, &self.yx, &self.yy]
    }

    /// Adds the entries of `scale A B^T` that are on the stencil; `a` and `b` are stacked by component.
    fn add_product(&mut self, a: MatRef<'_, f64>, b: MatRef<'_, f64>, scale: f64) {
        let n = self.xx.stencil().dimension();
        self.add_rows(&by_rows(a, n), &by_rows(b, n), scale);
    }

    /// Adds the entries of `A A^T`, likewise.
    fn add_square(&mut self, a: MatRef<'_, f64>) {
        let rows = by_rows(a, self.xx.stencil().dimension());
        self.add_rows(&rows, &rows, 1.0);
    }

    fn add_rows(&mut self, a: &[Vec<f64>; 2], b: &[Vec<f64>; 2], scale: f64) {
        let stencil = self.xx.stencil().clone();
        let width = a[0].len() / stencil.dimension();
        let parts = [(&mut self.xx, 0, 0), (&mut self.xy, 0, 1), (&mut self.yx, 1, 0), (&mut self.yy, 1, 1)];
        for (part, left, right) in parts {
            for ((p, q), value) in stencil.entries().zip(&mut part.values) {
                let (row, column) = (&a[left][p * width..(p + 1) * width], &b[right][q * width..(q + 1) * width]);
                *value += scale * inner_product(row, column);
            }
        }
    }
}

/// A stacked matrix row by row, either component by itself, in strips that stay in the cache.
fn by_rows(m: MatRef<'_, f64>, n: usize) -> [Vec<f64>; 2] {
    let width = m.ncols();
    [0, 1].map(|k| {
        let mut rows = vec![0.0; n * width];
        for (strip, into) in rows.chunks_mut(64 * width.max(1)).enumerate() {
            let height = into.len() / width;
            for column in 0..width {
                let values = m.col(column).subrows(k * n + 64 * strip, height);
                values.iter().enumerate().for_each(|(row, value)| into[row * width + column] = *value);
            }
        }
        rows
    })
}

/// In eight sums side by side, which vectorises; one running sum could not without changing its rounding.
fn inner_product(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a_head, a_tail) = a.as_chunks::<8>();
    let (b_head, b_tail) = b.as_chunks::<8>();
    for (a, b) in a_head.iter().zip(b_head) {
        (0..8).for_each(|k| sums[k] += a[k] * b[k]);
    }
    sums.iter().sum::<f64>() + a_tail.iter().zip(b_tail).map(|(a, b)| a * b).sum::<f64>()
}

/// An input that moves the surface in one cell along one direction: the mixed derivatives of the objective by it, in
/// units of its standard deviation.
struct SurfaceInput {
    direction: Vec2,
    support: [usize; SUPPORT],
    /// Along the direction.
    by_control_points: [f64; SUPPORT],
    /// Scans with the derivative by their three pose unknowns.
    by_poses: Vec<(usize, Vector3<f64>)>,
}

/// A surfel on the lattice.
struct Placed<'a> {
    surfel: &'a Surfel,
    support: [usize; SUPPORT],
    row: [f64; SUPPORT],
}

/// The surfels of active cells.
fn placed_surfels(fit: &VectorFit) -> impl Iterator<Item = Placed<'_>> {
    let lattice = &fit.field[0].lattice;
    let placed = fit.surfels.all.iter().map(|surfel| {
        let at = lattice.locate_or_extend(surfel.anchor);
        Placed { surfel, support: lattice.support(at.cell), row: lattice.row(&at).value }
    });
    placed.filter(|own| fit.objective.system.hessian.stencil().is_active_cell(own.support[0]))
}

/// All inputs but the poses: ranges, then what the spline cannot follow.
fn surface_inputs(fit: &VectorFit) -> Vec<SurfaceInput> {
    let mut inputs = Vec::new();
    // Surfels of one cell that face one way.
    let mut cells: BTreeMap<(usize, u8), Vec<Placed<'_>>> = BTreeMap::new();
    for own in placed_surfels(fit) {
        let n = own.surfel.normal;
        for witness in fit.surfels.witnesses(own.surfel) {
            let pull = 2.0 * witness.weight * witness.range_variance.sqrt();
            inputs.push(SurfaceInput {
                direction: n,
                support: own.support,
                by_control_points: own.row.map(|value| pull * value),
                by_poses: vec![(witness.scan, witness.by_pose * pull)],
            });
        }
        let quarter = u8::from(n.x.abs() > n.y.abs()) + 2 * u8::from(n.x + n.y > 0.0);
        cells.entry((own.support[0], quarter)).or_default().push(own);
    }
    inputs.extend(cells.into_values().filter_map(|own| misfit_input(fit, &own)));
    inputs
}

/// What the spline cannot follow of the surfels of one cell that face one way.
fn misfit_input(fit: &VectorFit, cell: &[Placed<'_>]) -> Option<SurfaceInput> {
    let direction = cell.iter().map(|own| own.surfel.normal).sum::<Vec2>().try_normalize(1e-9)?;
    let sigma = 2.0 * fit.weights.model_sigma.hypot(missed_by(fit, cell));
    let mut by_control_points = [0.0; SUPPORT];
    let mut by_poses = BTreeMap::<usize, Vector3<f64>>::new();
    for own in cell {
        by_control_points.iter_mut().zip(&own.row).for_each(|(b, value)| *b += sigma * own.surfel.weight * value);
        for witness in fit.surfels.witnesses(own.surfel) {
            let pull = sigma * witness.weight * own.surfel.normal.dot(&direction);
            *by_poses.entry(witness.scan).or_default() += witness.by_pose * pull;
        }
    }
    Some(SurfaceInput {
        direction,
        support: cell[0].support,
        by_control_points,
        by_poses: by_poses.into_iter().collect(),
    })
}

/// Computes the marginals of a vector fit.
pub fn vector_marginals(fit: &mut VectorFit) -> Result<(VectorMarginals, PoseCovariance), UncertaintyError> {
    let border = Bordered::factorise(&fit.objective.system, &mut fit.cholesky)?;
    let inputs = surface_inputs(fit);
    let g = on_stencil(fit, &inputs);
    let (inverse, xx) = selected_sandwich(&fit.cholesky, &g[0])?;
    let (_, xy) = selected_sandwich(&fit.cholesky, &g[1])?;
    let (_, yy) = selected_sandwich(&fit.cholesky, &g[2])?;
    let nothing = StencilMatrix::zeros(inverse.stencil().clone());
    let mut twice = inverse;
    twice.values.iter_mut().for_each(|v| *v *= 2.0);
    let mut marginals = VectorMarginals {
        propagated: VectorCovariance { xx, yx: xy.clone(), xy, yy },
        posterior: VectorCovariance { xx: twice.clone(), xy: nothing.clone(), yx: nothing, yy: twice },
    };
    let poses = match fit.weights.poses {
        Poses::Fixed => {
            add_fixed_poses(fit, &mut marginals.propagated)?;
            PoseCovariance::default()
        }
        Poses::Refined => add_refined_poses(fit, &border, (&inputs, &g), &mut marginals)?,
    };
    Ok((marginals, poses))
}

/// How far a fit misses surfels beyond what noise explains, metres (rms along their normals).
fn missed_by(fit: &VectorFit, cell: &[Placed<'_>]) -> f64 {
    let (mut weight, mut missed) = (0.0, 0.0);
    for own in cell {
        let [x, y] = [0, 1].map(|axis: usize| dot(&own.row, &gather(&fit.field[axis].coefficients, &own.support)));
        let residual = own.surfel.normal.dot(&Vec2::new(x, y)) + own.surfel.offset;
        weight += own.surfel.weight;
        missed += own.surfel.weight * residual * residual;
    }
    ((missed - cell.len() as f64) / weight).max(0.0).sqrt()
}

/// `G_xx`, `G_xy`, `G_yy`.
fn on_stencil(fit: &VectorFit, inputs: &[SurfaceInput]) -> [StencilMatrix; 3] {
    let stencil = fit.cholesky.stencil();
    let mut g: [StencilMatrix; 3] = std::array::from_fn(|_| StencilMatrix::zeros(stencil.clone()));
    for input in inputs {
        let own = CellBlock::symmetric_product(&input.by_control_points, &input.by_control_points);
        let n = input.direction;
        for (part, scale) in g.iter_mut().zip([n.x * n.x, n.x * n.y, n.y * n.y]) {
            let mut block = CellBlock::ZERO;
            block.add_scaled(scale, &own);
            part.add_cell(input.support[0], &block);
        }
    }
    g
}

/// The pose columns `2 w n_a B by_pose` of one scan after the other, by coefficient.
fn columns_by_scan(fit: &VectorFit) -> impl Iterator<Item = BTreeMap<usize, [f64; 3]>> + '_ {
    let n = fit.cholesky.dimension();
    let placed: Vec<Placed<'_>> = placed_surfels(fit).collect();
    let mut seen_by = vec![Vec::new(); fit.poses.len()];
    for (k, own) in placed.iter().enumerate() {
        fit.surfels.witnesses(own.surfel).iter().for_each(|witness| seen_by[witness.scan].push((k, *witness)));
    }
    seen_by.into_iter().map(move |seen| {
        let mut columns = BTreeMap::<usize, [f64; 3]>::new();
        for (k, witness) in seen {
            let Placed { surfel, support, row } = &placed[k];
            for (axis, (&point, value)) in (0..2).flat_map(|axis| support.iter().zip(row).map(move |at| (axis, at))) {
                let entry = columns.entry(axis * n + point).or_default();
                let pull = 2.0 * witness.weight * surfel.normal[axis] * value;
                (0..3).for_each(|a| entry[a] += pull * witness.by_pose[a]);
            }
        }
        columns
    })
}

fn add_fixed_poses(fit: &VectorFit, propagated: &mut VectorCovariance) -> Result<(), UncertaintyError> {
    let n = fit.cholesky.dimension();
    let block = (LARGEST_COLUMNS / (6 * n)).clamp(1, SCANS_A_BLOCK);
    let mut scans = columns_by_scan(fit);
    loop {
        let own: Vec<_> = scans.by_ref().take(block).collect();
        if own.is_empty() {
            return Ok(());
        }
        let mut columns = Mat::zeros(2 * n, 3 * own.len());
        for (k, scan) in own.iter().enumerate() {
            scan.iter().for_each(|(&row, values)| (0..3).for_each(|a| columns[(row, 3 * k + a)] = values[a]));
        }
        solve_components(&fit.cholesky, columns.as_mut())?;
        propagated.add_square(columns.as_ref());
    }
}

fn add_refined_poses(
    fit: &VectorFit,
    border: &Bordered,
    (inputs, g): (&[SurfaceInput], &[StencilMatrix; 3]),
    marginals: &mut VectorMarginals,
) -> Result<PoseCovariance, UncertaintyError> {
    let (n, w) = (fit.cholesky.dimension(), border.w.as_ref());
    let unknowns = w.ncols();
    let mut shared = Mat::<f64>::zeros(2 * n, unknowns);
    let mut own = Mat::<f64>::zeros(unknowns, unknowns);
    for input in inputs {
        for (scan, by_pose) in &input.by_poses {
            for (axis, a) in (0..2).flat_map(|axis| (0..3).map(move |a| (axis, a))) {
                let pull = input.direction[axis] * by_pose[a];
                for (&k, value) in input.support.iter().zip(&input.by_control_points) {
                    shared[(axis * n + k, 3 * scan + a)] += pull * value;
                }
            }
            for (other, by_other) in &input.by_poses {
                (0..9).for_each(|k| own[(3 * scan + k / 3, 3 * other + k % 3)] += by_pose[k / 3] * by_other[k % 3]);
            }
        }
    }
    let mut gw = Mat::<f64>::zeros(2 * n, unknowns);
    for (row, column, part) in [(0, 0, &g[0]), (0, 1, &g[1]), (1, 0, &g[1]), (1, 1, &g[2])] {
        let own = stencil_times(part, w.subrows(column * n, n));
        let mut into = gw.as_mut().subrows_mut(row * n, n);
        into += own;
    }
    let w_shared = w.transpose() * &shared;
    let middle = &own - &w_shared - w_shared.transpose() + w.transpose() * &gw;
    let s_inverse = border.solve_poses(Mat::identity(unknowns, unknowns));
    let modes = &fit.objective.system.gauge;
    let reported = pose_image(&s_inverse, modes);
    let q = &s_inverse * middle * &s_inverse + &reported * reported.transpose();

    let mut y = &shared - &gw;
    solve_components(&fit.cholesky, y.as_mut())?;
    let mut v = y * &s_inverse * faer::Scale(-1.0);
    matmul(v.as_mut(), Accum::Add, w, q.as_ref(), 0.5, Par::Seq);
    marginals.propagated.add_product(v.as_ref(), w, 1.0);
    marginals.propagated.add_product(w, v.as_ref(), 1.0);
    let spread = &s_inverse + (modes * modes.transpose()) * faer::Scale(0.5);
    let t = w * &spread;
    marginals.posterior.add_product(t.as_ref(), w, 2.0);
    let roots = || fit.viewpoints.iter().map(|viewpoint| viewpoint.root);
    Ok(PoseCovariance {
        propagated: poses_in_world(&q, 1.0, roots()),
        posterior: poses_in_world(&spread, 2.0, roots()),
    })
}

impl Factors {
    /// The factors of a vector fit.
    pub fn of_vector(fit: &VectorFit) -> Self {
        let system = &fit.objective.system;
        let (n, refined) = (fit.cholesky.dimension(), fit.weights.poses == Poses::Refined);
        let unknowns = system.coupling.ncols();
        let mut inputs = CompressedColumns::new(2 * n + unknowns);
        for input in surface_inputs(fit) {
            let at = |axis: usize| input.support.iter().map(move |&k| axis * n + k);
            let on_map = (0..2).flat_map(|axis| {
                at(axis).zip(input.by_control_points).map(move |(row, value)| (row, input.direction[axis] * value))
            });
            let border = input
                .by_poses
                .iter()
                .flat_map(|(scan, by_pose)| (0..3).map(move |a| (2 * n + 3 * scan + a, by_pose[a])));
            inputs.push(on_map.chain(border.filter(|_| refined)));
        }
        let mut coupling = CompressedColumns::new(2 * n);
        for (scan, columns) in columns_by_scan(fit).enumerate() {
            for a in 0..3 {
                let own = columns.iter().map(|(&row, values)| (row, values[a]));
                if refined {
                    coupling.push(own.clone());
                    let block = system.poses[scan] - Matrix3::identity() * 2.0;
                    inputs.push(own.chain((0..3).map(|b| (2 * n + 3 * scan + b, block[(b, a)]))));
                } else {
                    inputs.push(own);
                }
            }
        }
        Self {
            hessian: system.hessian.clone(),
            coupling,
            poses: system.poses.clone(),
            gauge: system.gauge.clone(),
            inputs,
            apart: None,
        }
    }
}
