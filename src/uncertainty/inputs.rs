//! The mixed derivatives of the objective by unknowns and inputs, times a square root of the inputs' covariance.
//!
//! Range inputs: one column a return, `sigma_r [f_cr; R^T f_qr]` with 16 control points and its scan's three pose
//! unknowns. Pose inputs: three columns a scan. A pose is `q0 + R e`; the reported `q0` and the unknown `e` enter the
//! objective in the same way except for the prior `|e|^2`, so the columns are those of the Hessian by `e` without the
//! prior's `2 I`: `[K; P - 2 I]`. With fixed poses there is no `e` and the columns are `f_cq R`.
//!
//! Misfit: one column a cell, the gradient of its Eikonal term at the minimum (calibrated maps). Where the surface can
//! have unit slope that vanishes; at ridges, which no spline follows, it is what they pull with. Treating the pulls of
//! different cells as independent errors of the model is the cluster-robust "sandwich" of Huber (1967) and White
//! (1980).

use nalgebra::{Matrix3, Vector3};

use crate::fit::{Curvature, Fit, InputJet, Sighting, Weighting, by_inputs, local_jet};
use crate::spline::{SUPPORT, gather};

/// By how much the pulls of a cell stand for those of its neighbours along a ridge, which are like it.
const ALIKE: f64 = 1.5;

/// A sparse matrix by columns: `indices[starts[k]..starts[k + 1]]` are the rows of column `k`, ascending.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CompressedColumns {
    pub rows: usize,
    pub starts: Vec<usize>,
    pub indices: Vec<usize>,
    pub values: Vec<f64>,
}

impl CompressedColumns {
    pub fn new(rows: usize) -> Self {
        Self { rows, starts: vec![0], indices: Vec::new(), values: Vec::new() }
    }

    pub fn columns(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Appends a column; the entries' rows must ascend.
    pub fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>) {
        for (row, value) in entries {
            self.indices.push(row);
            self.values.push(value);
        }
        self.starts.push(self.indices.len());
    }

    /// This matrix with another below and to the right of it.
    pub fn beside(mut self, other: &Self) -> Self {
        for k in 0..other.columns() {
            self.push(other.column(k).map(|(row, value)| (self.rows + row, value)).collect::<Vec<_>>());
        }
        self.rows += other.rows;
        self
    }

    /// A column's entries.
    pub fn column(&self, k: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let span = self.starts[k]..self.starts[k + 1];
        self.indices[span.clone()].iter().copied().zip(self.values[span].iter().copied())
    }
}

/// One return's column by its range.
pub struct RangeInputs {
    pub scan: usize,
    pub support: [usize; SUPPORT],
    /// `sigma_r f_cr` at the support.
    pub by_control_points: [f64; SUPPORT],
    /// `sigma_r R^T f_qr`; zero where poses are fixed.
    pub by_pose: Vector3<f64>,
}

/// One return's share in its scan's pose columns.
pub struct PoseInputs {
    pub scan: usize,
    pub support: [usize; SUPPORT],
    /// `f_cq R` at the support, column by column.
    pub by_control_points: [[f64; SUPPORT]; 3],
    /// `R^T f_qq R`.
    pub by_pose: Matrix3<f64>,
}

/// Calls back with every return's inputs, cell by cell.
pub fn for_each_return(fit: &Fit, mut each: impl FnMut(RangeInputs, PoseInputs)) {
    let objective = &fit.objective;
    let (lattice, sightings) = (&objective.lattice, &objective.sightings);
    let (c, e) = fit.unknowns.split_at(lattice.len());
    for (cell, seen) in objective.occupied(&sightings.at(lattice, e)) {
        let support = lattice.support(cell);
        let local = gather(c, &support);
        for sighting in seen {
            let inputs = input_jet(fit, sighting, &local);
            let viewpoint = &sightings.viewpoints[sighting.seen.scan];
            let (scan, root) = (sighting.seen.scan, &viewpoint.root);
            let sigma = viewpoint.noise.range_variance.sqrt();
            let by_pose = inputs.second.fixed_view::<3, 3>(0, 0);
            let range_and_pose = inputs.second.fixed_view::<3, 1>(0, 3);
            let range = RangeInputs {
                scan,
                support,
                by_control_points: inputs.mixed[3].map(|v| sigma * v),
                by_pose: root.transpose() * range_and_pose * sigma,
            };
            let pose = PoseInputs {
                scan,
                support,
                by_control_points: std::array::from_fn(|k| {
                    std::array::from_fn(|n| (0..3).map(|a| inputs.mixed[a][n] * root[(a, k)]).sum())
                }),
                by_pose: root.transpose() * by_pose * root,
            };
            each(range, pose);
        }
    }
}

/// Calls back with every cell's misfit; see the module.
pub fn for_each_misfit(fit: &Fit, mut each: impl FnMut(&[usize; SUPPORT], &[f64; SUPPORT])) {
    if fit.weighting == Weighting::Calibrated {
        let coefficients = &fit.unknowns[..fit.surface.lattice.len()];
        fit.objective.for_each_eikonal_score(coefficients, |support, score| each(support, &score.map(|s| ALIKE * s)));
    }
}

fn input_jet(fit: &Fit, sighting: &Sighting, local: &[f64; SUPPORT]) -> InputJet {
    let objective = &fit.objective;
    let row = objective.lattice.row(&sighting.located);
    let surface = local_jet(&row, local);
    let jet = objective.sightings.loss(sighting, surface.value, surface.gradient, Curvature::EXACT);
    let third = objective.third(&sighting.located, local);
    by_inputs(&row, &jet, &surface, &third, &sighting.seen, Curvature::EXACT)
}
