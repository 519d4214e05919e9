//! The objective of a signed-distance fit, its gradient and its Hessian.
//!
//! ```text
//! f(c, e) = sum over quadrature points  w_e rho(|grad u|^2 - 1)        2 x 2 (published) or 3 x 3 Gauss points a cell
//!         + integral of  lambda (u_xx^2 + 2 u_xy^2 + u_yy^2)          thin-plate energy
//!         + sum over returns  u(X)^2 / (g^T C g)   or   rho_o u(X)^2
//!         + |e|^2 + kappa |U^T e|^2                                   the poses' prior and gauge, where they are refined
//! ```
//!
//! after Arukgoda et al., CASE 2019. There is no factor 1/2. The unknowns are the coefficients `c`, then three numbers
//! `e` a scan where poses are refined ([`super::sightings`]). A uniform lattice has the same basis values at every
//! cell's quadrature points, so one table of products serves all cells; the thin-plate energy is the same constant
//! block in each. Returns are sorted by cell: a step adds one block per occupied cell.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::chain::{InputJet, by_control_points, by_inputs};
use super::eikonal::EikonalLoss;
use super::loss::Curvature;
use super::sightings::{Placed, Sighting, Sightings};
use crate::fit::PRIOR;
use crate::fit::collocation::{gauss, thin_plate};
use crate::fit::system::System;
use crate::geometry::{Cov3, Vec2};
use crate::sparse::{CellBlock, Pattern, Stencil, StencilMatrix, Views};
use crate::spline::{BasisRow, Jet, Lattice, Located, SUPPORT, dot, gather, third_derivatives};

/// A quadrature point's basis rows and the products a Hessian is made of.
struct QuadraturePoint {
    /// Its share of the cell.
    weight: f64,
    row: BasisRow,
    xx: CellBlock,
    xy: CellBlock,
    yy: CellBlock,
}

/// The objective over one lattice; see the module.
pub struct Objective {
    pub lattice: Lattice,
    pub stencil: Arc<Stencil>,
    pub eikonal: EikonalLoss,
    pub sightings: Sightings,
    quadrature: Vec<QuadraturePoint>,
    thin_plate: CellBlock,
    /// The cells in which the Eikonal term holds; `None` for all.
    eikonal_cells: Option<Vec<bool>>,
}

impl Objective {
    /// `smoothing` is the thin-plate weight `lambda`; `eikonal_cells` says, a cell each, where the Eikonal term holds;
    /// `points` Gauss points a side (2 to 4) integrate it.
    pub fn new(
        lattice: Lattice,
        stencil: Arc<Stencil>,
        sightings: Sightings,
        eikonal: EikonalLoss,
        smoothing: f64,
        eikonal_cells: Option<Vec<bool>>,
        points: usize,
    ) -> Self {
        let h = lattice.resolution;
        let side = gauss(points);
        let quadrature = side
            .iter()
            .flat_map(|&w| side.iter().map(move |&t| (t, w)))
            .map(|((t, along), (w, across))| {
                let row = BasisRow::at(t, w, h);
                let xx = CellBlock::symmetric_product(&row.dx, &row.dx);
                let xy = CellBlock::symmetric_product(&row.dx, &row.dy);
                let yy = CellBlock::symmetric_product(&row.dy, &row.dy);
                QuadraturePoint { weight: along * across, row, xx, xy, yy }
            })
            .collect();
        let thin_plate = thin_plate(h, smoothing);
        Self { lattice, stencil, eikonal, sightings, quadrature, thin_plate, eikonal_cells }
    }

    /// Changes the weights: the Eikonal loss, the thin-plate weight, and whether the poses are unknowns.
    pub fn reweigh(&mut self, eikonal: EikonalLoss, smoothing: f64, refined: bool) {
        self.eikonal = eikonal;
        self.thin_plate = thin_plate(self.lattice.resolution, smoothing);
        self.sightings.refine(refined);
    }

    /// The number of unknowns: control points, then pose unknowns.
    pub fn unknowns(&self) -> usize {
        self.lattice.len() + self.sightings.pose_unknowns()
    }

    /// An empty system of this objective's size, for returns where the pose unknowns `e` put them.
    pub fn system(&self, e: &[f64]) -> System {
        let seen = if self.sightings.refined { self.views(&self.sightings.at(&self.lattice, e)) } else { Vec::new() };
        System::zeros(self.pattern(&seen), self.sightings.gauge.clone())
    }

    /// Which cells each refined pose's returns lie in, as (pose, cell's lowest control point), ascending.
    fn views(&self, placed: &Placed) -> Vec<(usize, usize)> {
        let mut seen: Vec<(usize, usize)> = self
            .occupied(placed)
            .flat_map(|(cell, sightings)| {
                let first = self.lattice.support(cell)[0];
                sightings.iter().map(move |sighting| (sighting.seen.scan, first))
            })
            .collect();
        seen.sort_unstable();
        seen.dedup();
        seen
    }

    /// The pattern with every pose, refined or not, as reported.
    pub(super) fn pattern_of_all_poses(&self) -> Arc<Pattern> {
        let seen = self.views(&self.sightings.at(&self.lattice, &[]));
        self.pattern_of(self.sightings.viewpoints.len(), &seen)
    }

    fn pattern(&self, seen: &[(usize, usize)]) -> Arc<Pattern> {
        self.pattern_of(self.sightings.pose_unknowns() / 3, seen)
    }

    fn pattern_of(&self, poses: usize, seen: &[(usize, usize)]) -> Arc<Pattern> {
        let row = self.lattice.control_points()[0];
        let points = |first: usize| (0..SUPPORT).map(move |k| first + k % 4 + k / 4 * row);
        let pairs = seen.iter().flat_map(|&(pose, first)| points(first).map(move |point| (pose, point)));
        Pattern::new(self.stencil.clone(), 1, Views::of(poses, pairs))
    }

    /// Makes room in a system for what the poses see; what they saw before keeps its place.
    fn make_room(&self, placed: &Placed, system: &mut System) {
        let row = self.lattice.control_points()[0];
        let views = system.hessian.pattern().views();
        let whole = |&(pose, first): &(usize, usize)| {
            (0..SUPPORT).all(|k| views.position(pose, first + k % 4 + k / 4 * row).is_some())
        };
        let seen = self.views(placed);
        if seen.iter().all(whole) {
            return;
        }
        let points =
            seen.iter().flat_map(|&(pose, first)| (0..SUPPORT).map(move |k| (pose, first + k % 4 + k / 4 * row)));
        let views = Views::of(views.poses(), views.pairs().chain(points));
        *system = System::zeros(Pattern::new(self.stencil.clone(), 1, views), system.gauge.clone());
    }

    /// The objective's value at the unknowns.
    pub fn value(&self, unknowns: &[f64]) -> f64 {
        let (c, e) = unknowns.split_at(self.lattice.len());
        let mut total = self.prior(e);
        for cell in self.cells() {
            let local = gather(c, &self.lattice.support(cell));
            total += 0.5 * dot(&self.thin_plate.times(&local), &local);
            for point in self.quadrature_of(cell) {
                let g = Vec2::new(dot(&point.row.dx, &local), dot(&point.row.dy, &local));
                total += self.eikonal.value(point.weight, g);
            }
        }
        for (cell, sightings) in self.occupied(&self.sightings.at(&self.lattice, e)) {
            let local = gather(c, &self.lattice.support(cell));
            for sighting in sightings {
                let row = self.lattice.row(&sighting.located);
                let g = Vec2::new(dot(&row.dx, &local), dot(&row.dy, &local));
                total += self.sightings.loss(sighting, dot(&row.value, &local), g, Curvature::CONVEX).value;
            }
        }
        total
    }

    /// The gradient at the unknowns, without the Hessian where poses are fixed.
    pub fn gradient(&self, unknowns: &[f64]) -> Vec<f64> {
        if self.sightings.refined {
            let mut system = self.system(&unknowns[self.lattice.len()..]);
            self.assemble(unknowns, Curvature::CONVEX, &mut system);
            return system.gradient;
        }
        let mut gradient = vec![0.0; unknowns.len()];
        for cell in self.cells() {
            let support = self.lattice.support(cell);
            let local = gather(unknowns, &support);
            let mut slope = self.thin_plate.times(&local);
            for point in self.quadrature_of(cell) {
                let g = Vec2::new(dot(&point.row.dx, &local), dot(&point.row.dy, &local));
                let pull = self.eikonal.slope(point.weight, g);
                for ((into, dx), dy) in slope.iter_mut().zip(&point.row.dx).zip(&point.row.dy) {
                    *into += pull.x * dx + pull.y * dy;
                }
            }
            support.iter().zip(&slope).for_each(|(&k, s)| gradient[k] += s);
        }
        for (cell, sightings) in self.occupied(&self.sightings.at(&self.lattice, &[])) {
            let support = self.lattice.support(cell);
            let local = gather(unknowns, &support);
            for sighting in sightings {
                let row = self.lattice.row(&sighting.located);
                let g = Vec2::new(dot(&row.dx, &local), dot(&row.dy, &local));
                let jet = self.sightings.loss(sighting, dot(&row.value, &local), g, Curvature::CONVEX).gradient;
                for (k, &at) in support.iter().enumerate() {
                    gradient[at] += jet[0] * row.value[k] + jet[1] * row.dx[k] + jet[2] * row.dy[k];
                }
            }
        }
        gradient
    }

    /// Calls back with every cell's share of the Eikonal term's gradient: the control points, and the derivatives by
    /// them.
    pub fn for_each_eikonal_score(&self, c: &[f64], mut each: impl FnMut(&[usize; SUPPORT], &[f64; SUPPORT])) {
        for cell in self.cells().filter(|&cell| !self.quadrature_of(cell).is_empty()) {
            let support = self.lattice.support(cell);
            let local = gather(c, &support);
            let mut score = [0.0; SUPPORT];
            for point in self.quadrature_of(cell) {
                let g = Vec2::new(dot(&point.row.dx, &local), dot(&point.row.dy, &local));
                let pull = self.eikonal.slope(point.weight, g);
                for ((into, dx), dy) in score.iter_mut().zip(&point.row.dx).zip(&point.row.dy) {
                    *into += pull.x * dx + pull.y * dy;
                }
            }
            each(&support, &score);
        }
    }

    /// The value; gradient and Hessian are written over what `system` held.
    pub fn assemble(&self, unknowns: &[f64], curvature: Curvature, system: &mut System) -> f64 {
        let (c, e) = unknowns.split_at(self.lattice.len());
        let placed = self.sightings.at(&self.lattice, e);
        if self.sightings.refined {
            self.make_room(&placed, system);
        }
        system.clear();
        let surface = self.assemble_surface(c, curvature, system);
        let stencil = &self.stencil;
        system.hessian.shift_diagonal(|_, k| f64::from(u8::from(!stencil.is_active(k))));
        let sightings = self.assemble_sightings(c, &placed, curvature, system);
        for (gradient, e) in system.gradient[c.len()..].iter_mut().zip(e) {
            *gradient += 2.0 * e;
        }
        (0..e.len() / 3).for_each(|pose| system.hessian.add_pose(pose, &(Matrix3::identity() * PRIOR)));
        self.sightings.gauge.add_pull(e, &mut system.gradient[c.len()..]);
        surface + sightings + self.prior(e)
    }

    /// What the pose unknowns cost by themselves: their prior, and the gauge's spring.
    fn prior(&self, e: &[f64]) -> f64 {
        e.iter().map(|e| e * e).sum::<f64>() + self.sightings.gauge.energy(e)
    }

    fn assemble_surface(&self, c: &[f64], curvature: Curvature, system: &mut System) -> f64 {
        let mut total = 0.0;
        for cell in self.cells() {
            let support = self.lattice.support(cell);
            let local = gather(c, &support);
            let mut block = self.thin_plate;
            let mut slope = self.thin_plate.times(&local);
            total += 0.5 * dot(&slope, &local);
            for point in self.quadrature_of(cell) {
                let row = &point.row;
                let jet =
                    self.eikonal.jet(point.weight, Vec2::new(dot(&row.dx, &local), dot(&row.dy, &local)), curvature);
                total += jet.value;
                for ((slope, dx), dy) in slope.iter_mut().zip(&row.dx).zip(&row.dy) {
                    *slope += jet.gradient.x * dx + jet.gradient.y * dy;
                }
                block.add_scaled(jet.hessian[(0, 0)], &point.xx);
                block.add_scaled(2.0 * jet.hessian[(0, 1)], &point.xy);
                block.add_scaled(jet.hessian[(1, 1)], &point.yy);
            }
            support.iter().zip(&slope).for_each(|(&k, s)| system.gradient[k] += s);
            system.hessian.add_cell((0, 0), support[0], &block);
        }
        total
    }

    fn assemble_sightings(&self, c: &[f64], placed: &Placed, curvature: Curvature, system: &mut System) -> f64 {
        let mut total = 0.0;
        for (cell, sightings) in self.occupied(placed) {
            let support = self.lattice.support(cell);
            let local = gather(c, &support);
            let (mut block, mut slope) = (CellBlock::ZERO, [0.0; SUPPORT]);
            for sighting in sightings {
                let row = self.lattice.row(&sighting.located);
                let surface = local_jet(&row, &local);
                let jet = self.sightings.loss(sighting, surface.value, surface.gradient, curvature);
                total += jet.value;
                let own = by_control_points(&row, &jet, &mut block);
                slope.iter_mut().zip(&own).for_each(|(into, own)| *into += own);
                if self.sightings.refined {
                    let third = self.third(&sighting.located, &local);
                    let inputs = by_inputs(&row, &jet, &surface, &third, &sighting.seen, curvature);
                    let root = &self.sightings.viewpoints[sighting.seen.scan].root;
                    add_pose(system, sighting.seen.scan, &support, root, &inputs);
                }
            }
            support.iter().zip(&slope).for_each(|(&k, s)| system.gradient[k] += s);
            system.hessian.add_cell((0, 0), support[0], &block);
        }
        total
    }

    /// The distance's third derivatives at a located return.
    pub(crate) fn third(&self, at: &Located, local: &[f64; SUPPORT]) -> [f64; 4] {
        third_derivatives(&self.lattice, at, local)
    }

    /// What damping adds: the Hessian of `integral of |grad u|^2`, scaled so that one of it outweighs the most
    /// negative curvature the squared Eikonal loss can have, and a little of the identity.
    ///
    /// Negative curvature arises in gradient space, so it is damped there: smooth, long-wave changes, which are what
    /// the long thin valleys inside rooms need, go nearly undamped. With the identity alone a fit takes half as many
    /// steps again.
    pub fn damping(&self) -> StencilMatrix {
        const IDENTITY_SHARE: f64 = 0.01;
        let mut damping = StencilMatrix::zeros(self.stencil.clone());
        let mut block = CellBlock::ZERO;
        for point in &self.quadrature {
            block.add_scaled(8.0 * self.eikonal.weight, &point.xx);
            block.add_scaled(8.0 * self.eikonal.weight, &point.yy);
        }
        for cell in self.cells().filter(|&cell| !self.quadrature_of(cell).is_empty()) {
            damping.add_cell(self.lattice.support(cell)[0], &block);
        }
        let diagonal = damping.diagonal();
        let mean = diagonal.iter().sum::<f64>() / diagonal.len() as f64;
        damping.shift_diagonal(|_| IDENTITY_SHARE * mean);
        damping
    }

    fn quadrature_of(&self, cell: [usize; 2]) -> &[QuadraturePoint] {
        match &self.eikonal_cells {
            Some(held) if !held[self.lattice.cell_index(cell)] => &[],
            _ => &self.quadrature,
        }
    }

    /// The cells whose control points are in use.
    fn cells(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let [nx, ny] = self.lattice.cells;
        (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j])).filter(|&cell| self.uses(cell))
    }

    /// The occupied cells in use with their sightings.
    pub(crate) fn occupied<'a>(
        &'a self,
        placed: &'a Placed,
    ) -> impl Iterator<Item = ([usize; 2], &'a [Sighting])> + 'a {
        placed.by_cell(&self.lattice).filter(|(cell, _)| self.uses(*cell))
    }

    /// Whether a cell's control points are in use. A return that a refined pose puts where they are not is out of the
    /// map.
    fn uses(&self, cell: [usize; 2]) -> bool {
        self.stencil.is_active_cell(self.lattice.support(cell)[0])
    }
}

/// Adds one sighting's derivatives by its scan's pose unknowns, `q = q0 + R e`.
fn add_pose(system: &mut System, scan: usize, support: &[usize; SUPPORT], root: &Cov3, inputs: &InputJet) {
    let first = system.hessian.pattern().coefficients() + 3 * scan;
    let by_unknowns = root.transpose() * inputs.gradient.xyz();
    (0..3).for_each(|k| system.gradient[first + k] += by_unknowns[k]);
    let by_pose = |at: usize| root.transpose() * Vector3::from_fn(|a, _| inputs.mixed[a][at]);
    system.hessian.add_coupling((0, scan), support, by_pose);
    system.hessian.add_pose(scan, &(root.transpose() * inputs.second.fixed_view::<3, 3>(0, 0) * root));
}

/// A surface's jet from its basis row and its cell's coefficients.
#[inline]
pub(crate) fn local_jet(row: &BasisRow, local: &[f64; SUPPORT]) -> Jet {
    let xy = dot(&row.dxy, local);
    Jet {
        value: dot(&row.value, local),
        gradient: Vec2::new(dot(&row.dx, local), dot(&row.dy, local)),
        hessian: crate::geometry::Cov2::new(dot(&row.dxx, local), xy, xy, dot(&row.dyy, local)),
    }
}
