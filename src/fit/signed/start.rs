//! Where a fit starts: the signed distance to the nearest return, as a least-squares spline.
//!
//! The distance is sampled at the evidence's marks. It is negative where some beam passed. Elsewhere the nearest return
//! tells: positive behind its surface as the beam met it, negative before. (Positive wherever no beam passed would put
//! a jump, and with it a phantom surface, along the edge of what a scanner with a limited view saw of a free room.) A
//! nearest return is found in an R*-tree, which has no trouble with the many equal coordinates of a straight wall.

use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::fit::collocation::thin_plate;
use crate::geometry::{Vec2, turned};
use crate::scan::{Evidence, Return, SUBCELLS};
use crate::sparse::{CellBlock, Cholesky, SparseError, StencilMatrix};
use crate::spline::{BasisRow, Lattice, Surface};

/// Thin-plate-like ridge that keeps corner control points, which touch one cell alone, determined.
const RIDGE: f64 = 1e-6;

/// Neighbouring returns farther apart than this many cells say nothing about the surface's direction.
const LONGEST_CHORD: f64 = 3.0;
/// Beams to either side a chord spans at most.
const WIDEST_CHORD: isize = 8;

/// The starting surface. `returns` must not be empty. `blur` is the length, in cells, over which it is smoothed:
/// returns that scatter by half a cell would otherwise start as two walls.
pub fn signed_nearest_return(
    lattice: &Lattice,
    returns: &[Return],
    evidence: &Evidence,
    blur: f64,
    cholesky: &mut Cholesky,
) -> Result<Surface, SparseError> {
    let outward = outward_normals(returns, LONGEST_CHORD * lattice.resolution);
    let surfaces =
        returns.iter().zip(outward).map(|(seen, outward)| GeomWithData::new([seen.point.x, seen.point.y], outward));
    let tree = RTree::bulk_load(surfaces.collect());
    let at_mark = |[a, b]: [usize; 2], p: Vec2| signed_distance(&tree, p, evidence.mark(a, b).free);
    least_squares(lattice, blur, cholesky, at_mark)
}

/// The least-squares spline of a function sampled at the evidence's marks; `sample` is given a mark and its place.
/// `blur` is the length, in cells, over which it is smoothed.
pub fn least_squares(
    lattice: &Lattice,
    blur: f64,
    cholesky: &mut Cholesky,
    sample: impl Fn([usize; 2], Vec2) -> f64,
) -> Result<Surface, SparseError> {
    let samples = sample_rows(lattice.resolution);
    let mut normal = StencilMatrix::zeros(cholesky.pattern().stencil().clone());
    let mut rhs = vec![0.0; lattice.len()];
    // Thin-plate energy against SUBCELLS^2 samples a cell smooths over (weight h^2 / SUBCELLS^2)^(1/4).
    let weight = 0.5 * (SUBCELLS * SUBCELLS) as f64 * blur.powi(4) * lattice.resolution.powi(2);
    let block = samples.iter().fold(thin_plate(lattice.resolution, weight), |mut sum, (row, _)| {
        sum.add_scaled(1.0, &CellBlock::symmetric_product(&row.value, &row.value));
        sum
    });
    for j in 0..lattice.cells[1] {
        for i in 0..lattice.cells[0] {
            let support = lattice.support([i, j]);
            if !cholesky.pattern().stencil().is_active_cell(support[0]) {
                continue;
            }
            normal.add_cell(support[0], &block);
            for (k, (row, local)) in samples.iter().enumerate() {
                let mark = [i * SUBCELLS + k % SUBCELLS, j * SUBCELLS + k / SUBCELLS];
                let value = sample(mark, lattice.point([i, j], *local));
                for (&at, basis) in support.iter().zip(&row.value) {
                    rhs[at] += basis * value;
                }
            }
        }
    }
    normal.shift_diagonal(|_| RIDGE);
    cholesky.factorise(&normal)?;
    let coefficients = cholesky.solve_checked(&normal, &rhs)?;
    Ok(Surface { lattice: lattice.clone(), coefficients })
}

fn signed_distance(tree: &RTree<GeomWithData<[f64; 2], Vec2>>, p: Vec2, free: bool) -> f64 {
    let Some((nearest, distance2)) = tree.nearest_neighbor_with_distance_2([p.x, p.y]) else { return 0.0 };
    let offset = p - Vec2::new(nearest.geom()[0], nearest.geom()[1]);
    let behind = !free && offset.dot(&nearest.data) >= 0.0;
    if behind { distance2.sqrt() } else { -distance2.sqrt() }
}

/// Per return the unit normal of its surface, away from the scanner: across the chord between the farthest returns of
/// neighbouring beams that are still near, since a short chord shows noise; along the beam where there are none.
fn outward_normals(returns: &[Return], longest: f64) -> Vec<Vec2> {
    let farthest = |k: usize, step: isize| {
        let own = &returns[k];
        let mut end = own.point;
        for beams in 1..=WIDEST_CHORD {
            let Some(other) = k.checked_add_signed(step * beams).and_then(|k| returns.get(k)) else { break };
            let beside = other.scan == own.scan && other.beam.abs_diff(own.beam) == beams.unsigned_abs();
            if !beside || (other.point - own.point).norm() > longest {
                break;
            }
            end = other.point;
        }
        end
    };
    (0..returns.len())
        .map(|k| {
            let own = &returns[k];
            let chord = farthest(k, 1) - farthest(k, -1);
            let across = turned(chord).try_normalize(1e-9).unwrap_or(own.direction);
            if across.dot(&own.direction) < 0.0 { -across } else { across }
        })
        .collect()
}

/// The basis rows at a cell's evidence marks, x fastest, with the marks' local coordinates.
fn sample_rows(h: f64) -> Vec<(BasisRow, [f64; 2])> {
    let along = |k: usize| (k as f64 + 0.5) / SUBCELLS as f64;
    (0..SUBCELLS * SUBCELLS)
        .map(|k| [along(k % SUBCELLS), along(k / SUBCELLS)])
        .map(|local| (BasisRow::at(local[0], local[1], h), local))
        .collect()
}
