//! The mixed derivatives of a signed objective by unknowns and inputs, in units of the inputs' standard deviations.
//!
//! Ranges: one input a return, `sigma_r [f_cr; R^T f_qr]` with 16 control points and its scan's three pose unknowns.
//!
//! Misfit: one a cell, the gradient of its Eikonal term at the minimum (calibrated maps). Where the surface can have
//! unit slope that vanishes; at ridges, which no spline follows, it is what they pull with. Treating the pulls of
//! different cells as independent errors of the model is the cluster-robust "sandwich" of Huber (1967) and White
//! (1980).
//!
//! The reported poses are inputs, too, but need no columns: `q` and its report enter the prior alone together, so what
//! the map makes of a report's error is a row of the inverse Hessian ([`crate::uncertainty`]). For poses that are not
//! refined, [`with_held_poses`] adds them as unknowns that a stiff prior holds.

use nalgebra::{Matrix3, Vector3};

use super::chain::{InputJet, by_inputs};
use super::loss::Curvature;
use super::objective::{Objective, local_jet};
use super::sightings::Sighting;
use crate::fit::estimate::{HELD, Input, Inputs};
use crate::fit::gauge::Motions;
use crate::fit::options::Weighting;
use crate::fit::system::System;
use crate::spline::{SUPPORT, gather};

/// By how much the pulls of a cell stand for those of its neighbours along a ridge, which are like it.
const ALIKE: f64 = 1.5;

/// A signed objective at its minimum.
pub(super) struct SignedInputs {
    pub objective: Objective,
    pub unknowns: Vec<f64>,
    pub weighting: Weighting,
}

impl Inputs for SignedInputs {
    fn for_each(&self, each: &mut dyn FnMut(&Input<'_>)) {
        let nothing = [0.0; SUPPORT];
        let refined = self.objective.sightings.refined;
        for_each_sighting(&self.objective, &self.unknowns, |support, sighting, jet| {
            let viewpoint = &self.objective.sightings.viewpoints[sighting.seen.scan];
            let sigma = viewpoint.noise.range_variance.sqrt();
            let by_pose = viewpoint.root.transpose() * jet.second.fixed_view::<3, 1>(0, 3) * sigma;
            let pose = [(sighting.seen.scan, by_pose)];
            each(&Input {
                first: support[0],
                by_control_points: [jet.mixed[3].map(|v| sigma * v), nothing],
                by_poses: if refined { &pose } else { &[] },
            });
        });
        if self.weighting == Weighting::Calibrated {
            let coefficients = &self.unknowns[..self.objective.lattice.len()];
            self.objective.for_each_eikonal_score(coefficients, |support, score| {
                let by_control_points = [score.map(|s| ALIKE * s), nothing];
                each(&Input { first: support[0], by_control_points, by_poses: &[] });
            });
        }
    }
}

/// The system of an objective whose poses are known, with them as unknowns that do not move.
pub(super) fn with_held_poses(objective: &Objective, unknowns: &[f64], system: &System) -> System {
    let poses = objective.sightings.viewpoints.len();
    let mut held = System::zeros(objective.pattern_of_all_poses(), Motions::none(3 * poses));
    held.gradient[..system.gradient.len()].copy_from_slice(&system.gradient);
    held.hessian.add_diagonal_block(0, system.hessian.block(0, 0), 1.0);
    (0..poses).for_each(|pose| held.hessian.add_pose(pose, &(Matrix3::identity() * HELD)));
    for_each_sighting(objective, unknowns, |support, sighting, jet| {
        let root = &objective.sightings.viewpoints[sighting.seen.scan].root;
        let by_pose = |at: usize| root.transpose() * Vector3::from_fn(|a, _| jet.mixed[a][at]);
        held.hessian.add_coupling((0, sighting.seen.scan), support, by_pose);
    });
    held
}

/// Calls back with every return's derivatives by its pose and range, cell by cell.
fn for_each_sighting(
    objective: &Objective,
    unknowns: &[f64],
    mut each: impl FnMut(&[usize; SUPPORT], &Sighting, &InputJet),
) {
    let lattice = &objective.lattice;
    let (c, e) = unknowns.split_at(lattice.len());
    for (cell, seen) in objective.occupied(&objective.sightings.at(lattice, e)) {
        let support = lattice.support(cell);
        let local = gather(c, &support);
        for sighting in seen {
            let row = lattice.row(&sighting.located);
            let surface = local_jet(&row, &local);
            let jet = objective.sightings.loss(sighting, surface.value, surface.gradient, Curvature::EXACT);
            let third = objective.third(&sighting.located, &local);
            each(&support, sighting, &by_inputs(&row, &jet, &surface, &third, &sighting.seen, Curvature::EXACT));
        }
    }
}
