//! The quadratic objective of a vector fit: one sparse Hessian for both components, bordered by the poses.

use std::sync::Arc;

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use super::characteristics::{Characteristics, Course, collocation};
use super::surfels::Surfels;
use crate::fit::objective::thin_plate;
use crate::fit::{Minimum, System, Weights};
use crate::sparse::{CellBlock, Stencil, StencilMatrix};
use crate::spline::{BasisRow, Lattice};

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
}

impl VectorObjective {
    /// Assembles the objective of the active cells. `e` are the pose unknowns for which the surfels were gathered; it
    /// is empty where poses are fixed.
    pub fn assemble(
        lattice: &Lattice,
        stencil: Arc<Stencil>,
        surfels: &Surfels,
        characteristics: &Characteristics,
        weights: &Weights,
        (e, gauge): (&[f64], Mat<f64>),
    ) -> Self {
        let n = stencil.dimension();
        let system = System {
            gradient: vec![0.0; 2 * n + e.len()],
            hessian: StencilMatrix::zeros(stencil),
            coupling: Mat::zeros(2 * n, e.len()),
            poses: vec![Matrix3::identity() * 2.0; e.len() / 3],
            gauge,
        };
        let mut own = Self { system, constant: 0.0 };
        own.add_characteristics(lattice, characteristics, weights);
        own.add_surfels(lattice, surfels, e);
        let hessian = &mut own.system.hessian;
        let stencil = hessian.stencil().clone();
        let mean = hessian.diagonal().iter().sum::<f64>() / stencil.active_len().max(1) as f64;
        hessian.shift_diagonal(|k| if stencil.is_active(k) { RIDGE * mean } else { 1.0 });
        own
    }

    /// `rho_e |(n . grad) V - n|^2`, the hints where the field jumps, and the thin-plate energy.
    fn add_characteristics(&mut self, lattice: &Lattice, traced: &Characteristics, weights: &Weights) {
        let (h, n) = (lattice.resolution, lattice.len());
        let plate = thin_plate(h, weights.smoothing);
        let rows: Vec<BasisRow> =
            collocation().into_iter().flat_map(|w| collocation().map(|t| BasisRow::at(t, w, h))).collect();
        let share = 2.0 * h * h / rows.len() as f64;
        let [nx, ny] = lattice.cells;
        for cell in (0..nx * ny).map(|k| [k % nx, k / nx]) {
            let support = lattice.support(cell);
            if !self.system.hessian.stencil().is_active_cell(support[0]) {
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
            self.system.hessian.add_cell(support[0], &block);
        }
    }

    /// `sum over witnesses w |V(a) + (offset + by_pose.(e - e0)) n|^2`
    fn add_surfels(&mut self, lattice: &Lattice, surfels: &Surfels, e: &[f64]) {
        let n = lattice.len();
        for surfel in &surfels.all {
            let at = lattice.locate_or_extend(surfel.anchor);
            let (row, support) = (lattice.row(&at), lattice.support(at.cell));
            let System { gradient, hessian, poses, coupling, .. } = &mut self.system;
            if !hessian.stencil().is_active_cell(support[0]) {
                continue;
            }
            let mut block = CellBlock::ZERO;
            block.add_scaled(2.0 * surfel.weight, &CellBlock::symmetric_product(&row.value, &row.value));
            hessian.add_cell(support[0], &block);
            for witness in surfels.witnesses(surfel) {
                let (weight, s) = (2.0 * witness.weight, witness.by_pose);
                let mut offset = witness.offset;
                if let Some(e) = e.get(3 * witness.scan..3 * witness.scan + 3) {
                    offset -= s.dot(&Vector3::from_column_slice(e));
                    poses[witness.scan] += s * s.transpose() * weight;
                    (0..3).for_each(|a| gradient[2 * n + 3 * witness.scan + a] += weight * offset * s[a]);
                    for (axis, a) in (0..2).flat_map(|axis| (0..3).map(move |a| (axis, a))) {
                        let pull = weight * surfel.normal[axis] * s[a];
                        for (&k, value) in support.iter().zip(&row.value) {
                            coupling[(axis * n + k, 3 * witness.scan + a)] += pull * value;
                        }
                    }
                }
                for (&k, value) in support.iter().zip(&row.value) {
                    (0..2).for_each(|axis| gradient[axis * n + k] += weight * offset * surfel.normal[axis] * value);
                }
                self.constant += 0.5 * weight * offset.powi(2);
            }
        }
    }

    /// How well `z` minimises the objective, set against zero.
    pub fn minimum(&self, z: &[f64]) -> Minimum {
        let (mut objective, mut gradient_norm, mut first) = (self.constant, 0.0f64, 0.0f64);
        for ((z, bent), slope) in z.iter().zip(self.system.times(z)).zip(&self.system.gradient) {
            objective += z * (0.5 * bent + slope);
            gradient_norm = gradient_norm.max((bent + slope).abs());
            first = first.max(slope.abs());
        }
        let relative_gradient = if first > 0.0 { gradient_norm / first } else { gradient_norm };
        Minimum { objective, gradient_norm, relative_gradient, positive_definite: true, ..Minimum::default() }
    }
}
