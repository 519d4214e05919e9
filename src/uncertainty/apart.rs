//! The published covariance of a vector field: either component by itself, as if the other were not there.
//!
//! With Gauss-Newton's block `H_a` of component `a` and returns that share their scan's pose,
//!
//! ```text
//! posterior   2 H_a^-1
//! propagated  H_a^-1 B_a B_a^T H_a^-1,   B_a = d2f / dc_a dinputs = 2 rho_o (grad V_a B + V_a grad B) . dX
//! ```
//!
//! `dX` is a return's change by its range's standard deviation or along a column of its pose's covariance root.
//! Covariances between the components are zero by that form, not by nature.

use std::collections::BTreeMap;

use faer::Mat;

use super::inputs::CompressedColumns;
use super::marginals::{SCANS_A_BLOCK, add_products};
use super::{Factors, UncertaintyError, VectorCovariance, VectorMarginals};
use crate::fit::PublishedVectorFit;
use crate::geometry::Vec2;
use crate::sparse::{CellBlock, StencilMatrix, selected_sandwich};
use crate::spline::SUPPORT;

/// What moves one component.
struct Inputs {
    /// A column a return: its control points, and the derivatives by them.
    ranges: Vec<([usize; SUPPORT], [f64; SUPPORT])>,
    /// Three columns a scan, by control point.
    poses: Vec<BTreeMap<usize, [f64; 3]>>,
}

impl Inputs {
    fn of(fit: &PublishedVectorFit, axis: usize) -> Self {
        let (surface, stencil) = (&fit.field[axis], fit.cholesky.stencil());
        let mut own = Self { ranges: Vec::new(), poses: vec![BTreeMap::new(); fit.viewpoints.len()] };
        for (seen, trust) in fit.returns.iter().zip(&fit.trust) {
            let at = surface.lattice.locate_or_extend(seen.point);
            let support = surface.lattice.support(at.cell);
            if !stencil.is_active_cell(support[0]) {
                continue;
            }
            let (row, jet) = (surface.lattice.row(&at), surface.jet_at(&at));
            let by = |dx: Vec2| -> [f64; SUPPORT] {
                let slope = jet.gradient.dot(&dx);
                std::array::from_fn(|k| {
                    2.0 * trust * (slope * row.value[k] + jet.value * (row.dx[k] * dx.x + row.dy[k] * dx.y))
                })
            };
            let viewpoint = &fit.viewpoints[seen.scan];
            own.ranges.push((support, by(seen.direction * viewpoint.noise.range_variance.sqrt())));
            let moved = seen.by_pose() * viewpoint.root;
            for a in 0..3 {
                let change = by(moved.column(a).into());
                support.iter().zip(change).for_each(|(&k, v)| own.poses[seen.scan].entry(k).or_default()[a] += v);
            }
        }
        own
    }
}

/// The marginals and the factors of a published fit.
pub fn published_marginals(fit: &mut PublishedVectorFit) -> Result<(VectorMarginals, Factors), UncertaintyError> {
    let (x, mut factors) = component(fit, 0)?;
    let (y, beside) = component(fit, 1)?;
    factors.apart = Some(Box::new(beside));
    let nothing = StencilMatrix::zeros(fit.cholesky.stencil().clone());
    let pair =
        |xx: StencilMatrix, yy: StencilMatrix| VectorCovariance { xx, xy: nothing.clone(), yx: nothing.clone(), yy };
    let ([x_propagated, x_posterior], [y_propagated, y_posterior]) = (x, y);
    let marginals =
        VectorMarginals { propagated: pair(x_propagated, y_propagated), posterior: pair(x_posterior, y_posterior) };
    Ok((marginals, factors))
}

fn component(fit: &mut PublishedVectorFit, axis: usize) -> Result<([StencilMatrix; 2], Factors), UncertaintyError> {
    let inputs = Inputs::of(fit, axis);
    let (hessian, n) = (&fit.hessians[axis], fit.cholesky.dimension());
    fit.cholesky.factorise(hessian)?;
    let mut g = StencilMatrix::zeros(hessian.stencil().clone());
    let mut columns = CompressedColumns::new(n);
    for (support, own) in &inputs.ranges {
        g.add_cell(support[0], &CellBlock::symmetric_product(own, own));
        columns.push(support.iter().copied().zip(*own));
    }
    let (mut posterior, mut propagated) = selected_sandwich(&fit.cholesky, &g)?;
    posterior.values.iter_mut().for_each(|v| *v *= 2.0);
    for scans in inputs.poses.chunks(SCANS_A_BLOCK) {
        let mut moved = Mat::zeros(n, 3 * scans.len());
        for (k, scan) in scans.iter().enumerate() {
            scan.iter().for_each(|(&row, own)| (0..3).for_each(|a| moved[(row, 3 * k + a)] = own[a]));
            (0..3).for_each(|a| columns.push(scan.iter().map(|(&row, own)| (row, own[a]))));
        }
        fit.cholesky.solve_block(moved.as_mut())?;
        add_products(&mut propagated, moved.as_ref(), moved.as_ref(), 0.5);
    }
    let factors = Factors {
        hessian: hessian.clone(),
        coupling: CompressedColumns::new(n),
        poses: Vec::new(),
        gauge: Mat::zeros(0, 0),
        inputs: columns,
        apart: None,
    };
    Ok(([propagated, posterior], factors))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{FitOptions, Weighting, fit_published_vector};
    use crate::sim::Scenario;
    use crate::spline::Lattice;
    use crate::uncertainty::Kind;
    use std::ops::ControlFlow;

    #[test]
    fn either_component_agrees_with_dense_blocks_and_the_other_is_not_there() {
        let scenario = Scenario::experiment_one();
        let lattice = Lattice::covering(&scenario.bounds, 0.5, 10_000).unwrap();
        let options = FitOptions { weighting: Weighting::Paper, max_iterations: 5, ..Default::default() };
        let go = &mut |_: &crate::fit::Progress| ControlFlow::Continue(());
        let mut fit = fit_published_vector(&scenario.scans(1), &scenario.noise, &lattice, &options, go).unwrap();
        let (marginals, factors) = published_marginals(&mut fit).unwrap();
        let n = lattice.len();
        let window: Vec<usize> = (60..64).chain(n + 60..n + 64).collect();
        for kind in [Kind::Propagated, Kind::Posterior] {
            let block = factors.block(kind, &window).unwrap();
            let own = marginals.of(kind);
            for (row, column) in (0..8).flat_map(|row| (0..8).map(move |column| (row, column))) {
                let part = if row < 4 { &own.xx } else { &own.yy };
                let expected = match row / 4 == column / 4 {
                    true => part.stencil().position(60 + row % 4, 60 + column % 4).map_or(0.0, |k| part.values[k]),
                    false => 0.0,
                };
                let scale = (block[row * 9] * block[column * 9]).sqrt();
                assert!((block[row * 8 + column] - expected).abs() <= 1e-8 * scale, "{kind:?} ({row}, {column})");
            }
        }
        let reduced = factors.reduced(usize::MAX).unwrap();
        assert_eq!((reduced.hessian.rows, reduced.inputs.rows), (2 * n, 2 * n));
    }
}
