//! The quadratic objective of a vector fit: one sparse Hessian for both components, and the poses that tie them.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::characteristics::{Characteristics, Course, collocation};
use crate::fit::collocation::thin_plate;
use crate::fit::estimate::{HELD, Minimum, PRIOR};
use crate::fit::gauge::Motions;
use crate::fit::options::{Poses, Weights};
use crate::fit::surfels::{Surfel, Surfels};
use crate::fit::system::System;
use crate::sparse::{CellBlock, Pattern, SparseError, Stencil, StencilMatrix, Views};
use crate::spline::{BasisRow, Lattice, SUPPORT};

/// The weight of a hint, per square metre (and square metre of error): far below what poses and surfaces are known to.
const HINT: f64 = 20.0;
/// What keeps control points determined that only one cell's corner touches, as a share of the mean diagonal.
const RIDGE: f64 = 1e-9;

/// `f(z) = constant + gradient^T z + z^T M z / 2`, `z` the coefficients of `V_x`, those of `V_y` and the pose unknowns.
pub struct VectorObjective {
    /// `M`, and the gradient at zero.
    pub system: System,
    /// The objective at zero.
    pub constant: f64,
    /// How many unknowns are free: all, or the coefficients where the poses are held.
    free: usize,
}

impl VectorObjective {
    /// Assembles the objective of the active cells. `e` are the pose unknowns for which the surfels were gathered. Poses
    /// that are not refined are held. `before` is the last pattern there was; where it has room, it stays.
    pub fn assemble(
        lattice: &Lattice,
        stencil: &Arc<Stencil>,
        surfels: &Surfels,
        characteristics: &Characteristics,
        weights: &Weights,
        (e, gauge): (&[f64], Motions),
        before: &Arc<Pattern>,
    ) -> Result<Self, SparseError> {
        let views = views(lattice, stencil, surfels, e.len() / 3);
        views.check_size(2)?;
        let pattern = before.with_room_for(stencil, 2, views);
        let free = match weights.poses {
            Poses::Refined => pattern.dimension(),
            Poses::Fixed => pattern.coefficients(),
        };
        let mut own = Self { system: System::zeros(pattern, gauge), constant: 0.0, free };
        let mut component = StencilMatrix::zeros(stencil.clone());
        own.add_characteristics(lattice, characteristics, weights, &mut component);
        own.add_surfels(lattice, surfels, (e, weights.poses), &mut component);
        let mean = component.diagonal().iter().sum::<f64>() / stencil.active_len().max(1) as f64;
        component.shift_diagonal(|k| if stencil.is_active(k) { RIDGE * mean } else { 1.0 });
        let hessian = &mut own.system.hessian;
        (0..2).for_each(|k| hessian.add_diagonal_block(k, &component.values, 1.0));
        let prior = if weights.poses == Poses::Refined { PRIOR } else { HELD };
        (0..e.len() / 3).for_each(|pose| hessian.add_pose(pose, &(Matrix3::identity() * prior)));
        Ok(own)
    }

    /// `rho_e |(n . grad) V - n|^2`, the hints where the field jumps, and the thin-plate energy.
    fn add_characteristics(
        &mut self,
        lattice: &Lattice,
        traced: &Characteristics,
        weights: &Weights,
        component: &mut StencilMatrix,
    ) {
        let (h, n) = (lattice.resolution, lattice.len());
        let plate = thin_plate(h, weights.smoothing);
        let rows: Vec<BasisRow> =
            collocation().into_iter().flat_map(|w| collocation().map(|t| BasisRow::at(t, w, h))).collect();
        let share = 2.0 * h * h / rows.len() as f64;
        let [nx, ny] = lattice.cells;
        for cell in (0..nx * ny).map(|k| [k % nx, k / nx]) {
            let support = lattice.support(cell);
            if !component.stencil().is_active_cell(support[0]) {
                continue;
            }
            let mut block = plate;
            for (point, row) in rows.iter().enumerate() {
                let (wanted, asked, weight) = match traced.at(lattice, cell, point % 2, point / 2) {
                    Some(Course::Along(d)) => {
                        (d, std::array::from_fn(|k| d.x * row.dx[k] + d.y * row.dy[k]), weights.eikonal * share)
                    }
                    Some(Course::About(v)) => (v, row.value, HINT * share),
                    None => continue,
                };
                block.add_scaled(weight, &CellBlock::symmetric_product(&asked, &asked));
                for (&at, asked) in support.iter().zip(&asked) {
                    (0..2).for_each(|axis| self.system.gradient[axis * n + at] -= weight * wanted[axis] * asked);
                }
                self.constant += 0.5 * weight * wanted.norm_squared();
            }
            component.add_cell(support[0], &block);
        }
    }

    /// `sum over witnesses w |V(a) + (offset + by_pose.(e - e0)) n|^2`
    fn add_surfels(
        &mut self,
        lattice: &Lattice,
        surfels: &Surfels,
        (e, poses): (&[f64], Poses),
        component: &mut StencilMatrix,
    ) {
        let n = lattice.len();
        for surfel in &surfels.all {
            let at = lattice.locate_or_extend(surfel.anchor);
            let (row, support) = (lattice.row(&at), lattice.support(at.cell));
            let System { gradient, hessian, .. } = &mut self.system;
            if !component.stencil().is_active_cell(support[0]) {
                continue;
            }
            let mut block = CellBlock::ZERO;
            block.add_scaled(2.0 * surfel.weight, &CellBlock::symmetric_product(&row.value, &row.value));
            component.add_cell(support[0], &block);
            for witness in surfels.witnesses(surfel) {
                let (weight, s) = (2.0 * witness.weight, witness.by_pose);
                let mut offset = witness.offset;
                for axis in 0..2 {
                    let pull = s * (weight * surfel.normal[axis]);
                    hessian.add_coupling((axis, witness.scan), &support, |at| pull * row.value[at]);
                }
                if poses == Poses::Refined {
                    let own = 3 * witness.scan;
                    offset -= s.dot(&Vector3::from_column_slice(&e[own..own + 3]));
                    hessian.add_pose(witness.scan, &(s * s.transpose() * weight));
                    (0..3).for_each(|a| gradient[2 * n + own + a] += weight * offset * s[a]);
                }
                for (&k, value) in support.iter().zip(&row.value) {
                    (0..2).for_each(|axis| gradient[axis * n + k] += weight * offset * surfel.normal[axis] * value);
                }
                self.constant += 0.5 * weight * offset.powi(2);
            }
        }
    }

    /// The gradient at `z`.
    pub fn slope(&self, z: &[f64]) -> Vec<f64> {
        self.system.times(z).iter().zip(&self.system.gradient).map(|(bent, slope)| bent + slope).collect()
    }

    /// How well `z` minimises the objective, set against zero.
    pub fn minimum(&self, z: &[f64]) -> Minimum {
        let (mut objective, mut gradient_norm, mut first) = (self.constant, 0.0f64, 0.0f64);
        for ((z, bent), slope) in z.iter().zip(self.system.times(z)).zip(&self.system.gradient).take(self.free) {
            objective += z * (0.5 * bent + slope);
            gradient_norm = gradient_norm.max((bent + slope).abs());
            first = first.max(slope.abs());
        }
        let relative_gradient = if first > 0.0 { gradient_norm / first } else { gradient_norm };
        Minimum { objective, gradient_norm, relative_gradient, positive_definite: true, ..Minimum::default() }
    }
}

/// What every pose sees of the active cells.
fn views(lattice: &Lattice, stencil: &Stencil, surfels: &Surfels, poses: usize) -> Views {
    let mut cells: Vec<(usize, usize)> = surfels
        .all
        .iter()
        .flat_map(|surfel: &Surfel| {
            let first = lattice.support(lattice.locate_or_extend(surfel.anchor).cell)[0];
            surfels.witnesses(surfel).iter().map(move |witness| (witness.scan, first))
        })
        .filter(|(_, first)| stencil.is_active_cell(*first))
        .collect();
    cells.sort_unstable();
    cells.dedup();
    let row = lattice.control_points()[0];
    let points = |(pose, first): (usize, usize)| (0..SUPPORT).map(move |k| (pose, first + k % 4 + k / 4 * row));
    Views::of(poses, cells.into_iter().flat_map(points))
}
