//! Where a fit starts: the signed distance to the nearest return, as a least-squares spline.
//!
//! The distance is sampled at the evidence's marks; it is negative where some beam passed and positive elsewhere. A
//! nearest return is found in an R*-tree, which has no trouble with the many equal coordinates of a straight wall.

use rstar::RTree;

use crate::geometry::Vec2;
use crate::scan::{Evidence, SUBCELLS};
use crate::sparse::{CellBlock, Cholesky, SparseError, StencilMatrix};
use crate::spline::{BasisRow, Lattice, Surface};

/// Thin-plate-like ridge that keeps corner control points, which touch one cell alone, determined.
const RIDGE: f64 = 1e-6;

/// The starting surface. `returns` must not be empty.
pub fn signed_nearest_return(
    lattice: &Lattice,
    returns: &[Vec2],
    evidence: &Evidence,
    cholesky: &mut Cholesky,
) -> Result<Surface, SparseError> {
    let tree = RTree::bulk_load(returns.iter().map(|p| [p.x, p.y]).collect());
    let samples = sample_rows(lattice.resolution);
    let mut normal = StencilMatrix::zeros(cholesky.stencil().clone());
    let mut rhs = vec![0.0; lattice.len()];
    let block = samples.iter().fold(CellBlock::ZERO, |mut sum, (row, _)| {
        sum.add_scaled(1.0, &CellBlock::symmetric_product(&row.value, &row.value));
        sum
    });
    for j in 0..lattice.cells[1] {
        for i in 0..lattice.cells[0] {
            let support = lattice.support([i, j]);
            normal.add_cell(support[0], &block);
            for (k, (row, local)) in samples.iter().enumerate() {
                let p = lattice.point([i, j], *local);
                let (a, b) = (i * SUBCELLS + k % SUBCELLS, j * SUBCELLS + k / SUBCELLS);
                let sign = if evidence.mark(a, b).free { -1.0 } else { 1.0 };
                let distance = sign * nearest(&tree, p);
                for (&at, value) in support.iter().zip(&row.value) {
                    rhs[at] += value * distance;
                }
            }
        }
    }
    normal.shift_diagonal(|_| RIDGE);
    cholesky.factorise(&normal)?;
    let coefficients = cholesky.solve_checked(&normal, &rhs)?;
    Ok(Surface { lattice: lattice.clone(), coefficients })
}

fn nearest(tree: &RTree<[f64; 2]>, p: Vec2) -> f64 {
    tree.nearest_neighbor_with_distance_2([p.x, p.y]).map_or(0.0, |(_, distance2)| distance2.sqrt())
}

/// The basis rows at a cell's evidence marks, x fastest, with the marks' local coordinates.
fn sample_rows(h: f64) -> Vec<(BasisRow, [f64; 2])> {
    let along = |k: usize| (k as f64 + 0.5) / SUBCELLS as f64;
    (0..SUBCELLS * SUBCELLS)
        .map(|k| [along(k % SUBCELLS), along(k / SUBCELLS)])
        .map(|local| (BasisRow::at(local[0], local[1], h), local))
        .collect()
}
