//! The inputs of a published vector fit: ranges, and poses as unknowns that do not move.
//!
//! ```text
//! B = d2f / dc dinputs = 2 rho_o (grad V B + V grad B) . dX
//! ```
//!
//! at every return, with `dX` its change by its range's standard deviation or along a column of its pose's covariance root.

use nalgebra::{Matrix3, Vector3};

use crate::fit::estimate::{HELD, Input, Inputs};
use crate::fit::gauge::Motions;
use crate::fit::system::System;
use crate::fit::viewpoint::Viewpoint;
use crate::geometry::Vec2;
use crate::scan::Return;
use crate::sparse::{Pattern, Stencil, StencilMatrix, Views};
use crate::spline::{SUPPORT, Surface};

/// A published vector fit where it stopped.
pub(super) struct PublishedInputs {
    pub field: [Surface; 2],
    pub stencil: std::sync::Arc<Stencil>,
    pub returns: Vec<Return>,
    pub trust: Vec<f64>,
    pub viewpoints: Vec<Viewpoint>,
}

impl PublishedInputs {
    /// Calls back with every return in use: its cell's control points, and the derivatives by a change of its place.
    fn for_each_return(&self, mut each: impl FnMut(&Return, [usize; SUPPORT], &dyn Fn(Vec2) -> [[f64; SUPPORT]; 2])) {
        let lattice = &self.field[0].lattice;
        for (seen, trust) in self.returns.iter().zip(&self.trust) {
            let at = lattice.locate_or_extend(seen.point);
            let support = lattice.support(at.cell);
            if !self.stencil.is_active_cell(support[0]) {
                continue;
            }
            let row = lattice.row(&at);
            let jets = [self.field[0].jet_at(&at), self.field[1].jet_at(&at)];
            each(seen, support, &|dx: Vec2| {
                jets.map(|jet| {
                    let slope = jet.gradient.dot(&dx);
                    std::array::from_fn(|k| {
                        2.0 * trust * (slope * row.value[k] + jet.value * (row.dx[k] * dx.x + row.dy[k] * dx.y))
                    })
                })
            });
        }
    }

    /// Gauss-Newton's blocks with the poses as unknowns that do not move.
    pub fn system(&self, hessians: &[StencilMatrix; 2]) -> System {
        let poses = self.viewpoints.len();
        let mut pairs = Vec::new();
        self.for_each_return(|seen, support, _| pairs.extend(support.map(|point| (seen.scan, point))));
        let pattern = Pattern::new(self.stencil.clone(), 2, Views::of(poses, pairs));
        let mut system = System::zeros(pattern, Motions::none(3 * poses));
        (0..2).for_each(|k| system.hessian.add_diagonal_block(k, &hessians[k].values, 1.0));
        (0..poses).for_each(|pose| system.hessian.add_pose(pose, &(Matrix3::identity() * HELD)));
        self.for_each_return(|seen, support, by| {
            let moved = seen.by_pose() * self.viewpoints[seen.scan].root;
            let by_pose = [0, 1, 2].map(|a| by(moved.column(a).into()));
            (0..2).for_each(|axis| {
                let own = |at: usize| Vector3::from_fn(|a, _| by_pose[a][axis][at]);
                system.hessian.add_coupling((axis, seen.scan), &support, own);
            });
        });
        system
    }
}

impl Inputs for PublishedInputs {
    fn for_each(&self, each: &mut dyn FnMut(&Input<'_>)) {
        self.for_each_return(|seen, support, by| {
            let sigma = self.viewpoints[seen.scan].noise.range_variance.sqrt();
            each(&Input { first: support[0], by_control_points: by(seen.direction * sigma), by_poses: &[] });
        });
    }
}
