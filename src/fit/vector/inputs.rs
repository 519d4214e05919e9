//! The inputs of a vector fit: ranges, and what the spline cannot follow, in units of their standard deviations.
//!
//! A range moves its surfel's offset along the normal. What the spline cannot follow moves the surfels of one cell that
//! face one way, all at once, along their mean normal; its size is the model's own sigma, or what the fit missed them
//! by beyond noise.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::fit::estimate::{Input, Inputs};
use crate::fit::surfels::{Surfel, Surfels};
use crate::geometry::Vec2;
use crate::sparse::Stencil;
use crate::spline::{Lattice, SUPPORT, Surface, dot, gather};

/// A vector fit at its minimum.
pub(super) struct VectorInputs {
    pub field: [Surface; 2],
    pub surfels: Surfels,
    pub stencil: std::sync::Arc<Stencil>,
    /// What the spline cannot follow in any case, metres.
    pub model_sigma: f64,
    /// Whether poses are unknowns.
    pub refined: bool,
}

/// A surfel on the lattice.
#[derive(Clone, Copy)]
struct Placed<'a> {
    surfel: &'a Surfel,
    support: [usize; SUPPORT],
    row: [f64; SUPPORT],
}

impl VectorInputs {
    fn lattice(&self) -> &Lattice {
        &self.field[0].lattice
    }

    /// The surfels of active cells.
    fn placed(&self) -> impl Iterator<Item = Placed<'_>> {
        let lattice = self.lattice();
        let placed = self.surfels.all.iter().map(|surfel| {
            let at = lattice.locate_or_extend(surfel.anchor);
            Placed { surfel, support: lattice.support(at.cell), row: lattice.value_row(&at) }
        });
        placed.filter(|own| self.stencil.is_active_cell(own.support[0]))
    }

    /// How far the fit misses surfels beyond what noise explains, metres (rms along their normals).
    fn missed_by(&self, cell: &[Placed<'_>]) -> f64 {
        let (mut weight, mut missed) = (0.0, 0.0);
        for own in cell {
            let [x, y] = [0, 1].map(|axis: usize| dot(&own.row, &gather(&self.field[axis].coefficients, &own.support)));
            let residual = own.surfel.normal.dot(&Vec2::new(x, y)) + own.surfel.offset;
            weight += own.surfel.weight;
            missed += own.surfel.weight * residual * residual;
        }
        ((missed - cell.len() as f64) / weight).max(0.0).sqrt()
    }

    /// What the spline cannot follow of the surfels of one cell that face one way.
    fn misfit(&self, cell: &[Placed<'_>], each: &mut dyn FnMut(&Input<'_>)) {
        let facing = cell.iter().map(|own| own.surfel.normal).sum::<Vec2>();
        let Some(direction) = facing.try_normalize(1e-9) else { return };
        let sigma = 2.0 * self.model_sigma.hypot(self.missed_by(cell));
        let mut by_control_points = [0.0; SUPPORT];
        let mut by_poses = BTreeMap::<usize, Vector3<f64>>::new();
        for own in cell {
            by_control_points.iter_mut().zip(&own.row).for_each(|(b, value)| *b += sigma * own.surfel.weight * value);
            for witness in self.surfels.witnesses(own.surfel).iter().filter(|_| self.refined) {
                let pull = sigma * witness.weight * own.surfel.normal.dot(&direction);
                *by_poses.entry(witness.scan).or_default() += witness.by_pose * pull;
            }
        }
        let first = cell[0].support[0];
        let by_poses: Vec<_> = by_poses.into_iter().collect();
        each(&Input { first, by_control_points: along(direction, &by_control_points), by_poses: &by_poses });
    }
}

impl Inputs for VectorInputs {
    fn for_each(&self, each: &mut dyn FnMut(&Input<'_>)) {
        // Surfels of one cell that face one way.
        let mut cells: BTreeMap<(usize, u8), Vec<Placed<'_>>> = BTreeMap::new();
        for own in self.placed() {
            let n = own.surfel.normal;
            for witness in self.surfels.witnesses(own.surfel) {
                let pull = 2.0 * witness.weight * witness.range_variance.sqrt();
                let pose = [(witness.scan, witness.by_pose * pull)];
                each(&Input {
                    first: own.support[0],
                    by_control_points: along(n, &own.row.map(|value| pull * value)),
                    by_poses: if self.refined { &pose } else { &[] },
                });
            }
            let quarter = u8::from(n.x.abs() > n.y.abs()) + 2 * u8::from(n.x + n.y > 0.0);
            cells.entry((own.support[0], quarter)).or_default().push(own);
        }
        cells.into_values().for_each(|own| self.misfit(&own, each));
    }
}

/// A row of both components along a direction.
fn along(n: Vec2, row: &[f64; SUPPORT]) -> [[f64; SUPPORT]; 2] {
    [row.map(|v| n.x * v), row.map(|v| n.y * v)]
}
