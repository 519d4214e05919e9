//! Entries of the inverse, and of the sandwich, between any few unknowns, and forms of them: a walk up the elimination
//! tree.
//!
//! `H = L L^T` gives `(H^-1)_ww = V^T V` with `V = L^-1 E_w`, and a column of `V` is zero but on its unknown's path to the
//! root of the elimination tree (Gilbert and Peierls 1988). The paths of a window meet soon, in separators that grow
//! like the map's side, so a window of a large map costs what those separators do, not what the map does.
//!
//! The sandwich `S = H^-1 G H^-1` is `-d/dt (H + t G)^-1` at `t = 0` (see `selected`), so it needs the same walk in dual
//! numbers and nothing off the paths. For a supernode with factor `L11`, `L21`, the elimination's derivative
//! `G11`, `G21` and what its children left of the right-hand sides, `u` and `du`:
//!
//! ```text
//! P = L11^-1 G11 L11^-T,        Q = G21 L11^-T - L21 P             once
//! v = L11^-1 u,                 dv = L11^-1 du,  e = dv - P v
//! H^-1 += v^T v,                S -= (v^T dv + v^T e)/2 and its transpose
//! u2   -= L21 v,                du2 -= L21 dv + Q v                rows below
//! ```
//!
//! `P` and `Q` stand where the derivative stood, so a walk reads both panels once. With few columns that is all the time it takes.

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::cholesky::Cholesky;
use super::error::SparseError;
use super::few::Panel;
use super::selected::eliminate_derivative;
use super::system::SystemMatrix;
use super::team::Pace;
use super::tree::Shape;

/// A factor, and `P` and `Q` of all supernodes; see the module.
pub struct Paths {
    cholesky: Cholesky,
    related: Vec<f64>,
}

/// Whose entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Of {
    /// `H^-1`.
    Inverse,
    /// `H^-1 G H^-1`.
    Sandwich,
}

impl Paths {
    /// From the factor of `H`, and `G` on its pattern. `go_on` is told how far it is and says whether to go on.
    pub fn of(cholesky: Cholesky, g: &SystemMatrix, go_on: &dyn Fn(f64) -> bool) -> Result<Self, SparseError> {
        let mut related = eliminate_derivative(&cholesky, g, &|share| go_on(SHARE_OF_ELIMINATION * share))?;
        relate_all(&cholesky, &mut related, &|share| {
            go_on(SHARE_OF_ELIMINATION + (1.0 - SHARE_OF_ELIMINATION) * share)
        })?;
        Ok(Self { cholesky, related })
    }

    /// Bytes it holds in memory.
    pub fn held_bytes(&self) -> usize {
        self.cholesky.held_bytes() + 8 * (self.related.len() + 4 * self.cholesky.dimension())
    }

    /// Bytes that forms of so many columns hold while they are formed, at most: as if their paths were all of the tree.
    pub fn most_bytes(&self, columns: usize) -> usize {
        bytes(self.cholesky.dimension(), columns)
    }

    /// Bytes that these forms hold while they are formed.
    pub fn forming_bytes<C: AsRef<[(usize, f64)]>>(&self, columns: &[C]) -> Result<usize, SparseError> {
        let (shape, inverse) = (self.cholesky.shape()?, self.cholesky.steps());
        let entries: Vec<Entry> = columns.iter().enumerate().flat_map(|(k, own)| entries(k, own, inverse)).collect();
        Ok(bytes(Walk::of(shape, &entries).rows, columns.len()))
    }

    /// The forms `E^T H^-1 E`, or those of the sandwich, of columns `E` of few unknowns each, in their order. `go_on` says
    /// whether to go on.
    pub fn forms<C: AsRef<[(usize, f64)]>>(
        &self,
        columns: &[C],
        of: Of,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Mat<f64>, SparseError> {
        let (shape, inverse) = (self.cholesky.shape()?, self.cholesky.steps());
        let first = |column: &C| column.as_ref().iter().map(|(unknown, _)| inverse[*unknown]).min();
        let mut order: Vec<usize> = (0..columns.len()).collect();
        order.sort_by_key(|&k| first(&columns[k]));
        let entries: Vec<Entry> =
            order.iter().enumerate().flat_map(|(column, &k)| entries(column, &columns[k], inverse)).collect();
        let walk = Walk::of(shape, &entries);
        let mut sides = Sides::start(&walk, columns.len(), &entries);
        for visit in &walk.visits {
            if !go_on() {
                return Err(SparseError::Stopped);
            }
            let l = shape.panel(visit.supernode, self.cholesky.values());
            match of {
                Of::Inverse => sides.pass(visit, l),
                Of::Sandwich => sides.pass_dual(visit, l, shape.panel(visit.supernode, &self.related)),
            }
        }
        let mut back = vec![0; columns.len()];
        order.iter().enumerate().for_each(|(sorted, &asked)| back[asked] = sorted);
        let sum = sides.sum;
        let entry = |a: usize, b: usize| match of {
            Of::Inverse => sum[(a.max(b), a.min(b))],
            Of::Sandwich => -sum[(a, b)] - sum[(b, a)],
        };
        Ok(Mat::from_fn(back.len(), back.len(), |a, b| entry(back[a], back[b])))
    }
}

/// An entry of a right-hand side.
struct Entry {
    column: usize,
    /// When its unknown is eliminated.
    step: usize,
    value: f64,
}

fn entries<'a, C: AsRef<[(usize, f64)]>>(
    column: usize,
    own: &'a C,
    inverse: &'a [usize],
) -> impl Iterator<Item = Entry> + 'a {
    own.as_ref().iter().map(move |&(unknown, value)| Entry { column, step: inverse[unknown], value })
}

/// Both sides on so many rows, and the sum as it is formed, put back in order and handed on.
fn bytes(rows: usize, columns: usize) -> usize {
    8 * columns * (2 * rows + 3 * columns)
}

/// A supernode on a path: where its rows lie among all paths' rows, and which columns may not be zero there.
struct Visit {
    supernode: usize,
    /// The places of its own rows.
    first: usize,
    width: usize,
    /// The places of the rows below.
    below: Vec<usize>,
    /// Columns, by the order of elimination.
    columns: std::ops::Range<usize>,
}

/// The supernodes on the paths, children before parents.
struct Walk {
    visits: Vec<Visit>,
    rows: usize,
    /// Where every entry lies among all paths' rows.
    places: Vec<usize>,
}

impl Walk {
    fn of(shape: Shape<'_>, entries: &[Entry]) -> Self {
        let (symbolic, owner) = (shape.symbolic, shape.tree.owner());
        let mut columns: Vec<Option<(usize, usize)>> = vec![None; symbolic.n_supernodes()];
        let widen = |range: &mut Option<(usize, usize)>, (low, high): (usize, usize)| {
            *range = Some(range.map_or((low, high), |(a, b)| (a.min(low), b.max(high))));
        };
        entries.iter().for_each(|own| widen(&mut columns[owner[own.step]], (own.column, own.column + 1)));
        let (mut firsts, mut rows) = (vec![0; symbolic.n_supernodes()], 0);
        for s in 0..symbolic.n_supernodes() {
            let Some(range) = columns[s] else { continue };
            firsts[s] = rows;
            rows += symbolic.supernode_end()[s] - symbolic.supernode_begin()[s];
            if let Some(&parent) = symbolic.supernode(s).pattern().first() {
                widen(&mut columns[owner[parent]], range);
            }
        }
        let place = |step: usize| firsts[owner[step]] + step - symbolic.supernode_begin()[owner[step]];
        let visit = |(s, range): (usize, &Option<(usize, usize)>)| {
            let (low, high) = (*range)?;
            Some(Visit {
                supernode: s,
                first: firsts[s],
                width: symbolic.supernode_end()[s] - symbolic.supernode_begin()[s],
                below: symbolic.supernode(s).pattern().iter().map(|&step| place(step)).collect(),
                columns: low..high,
            })
        };
        let visits = columns.iter().enumerate().filter_map(visit).collect();
        Self { visits, rows, places: entries.iter().map(|own| place(own.step)).collect() }
    }
}

/// The right-hand sides on the paths and their derivative, and what they add up to: of the inverse the lower triangle, of
/// the sandwich minus one half, to be added to its transpose.
struct Sides {
    u: Mat<f64>,
    du: Mat<f64>,
    sum: Mat<f64>,
}

impl Sides {
    fn start(walk: &Walk, count: usize, entries: &[Entry]) -> Self {
        let mut u = Mat::zeros(walk.rows, count);
        entries.iter().zip(&walk.places).for_each(|(own, &place)| u[(place, own.column)] += own.value);
        Self { u, du: Mat::zeros(walk.rows, count), sum: Mat::zeros(count, count) }
    }

    fn pass(&mut self, visit: &Visit, l: Panel<'_>) {
        let mut x = [visit.above_zeros(&self.u)];
        l.eliminate(&mut x);
        let [x] = x;
        let v = x.subrows(0, visit.width);
        let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
        let into = visit.square(&mut self.sum);
        triangular::matmul(into, lower, Accum::Add, v.transpose(), whole, v, whole, 1.0, Par::Seq);
        add_below(self.u.as_mut(), visit, x.as_ref());
    }

    fn pass_dual(&mut self, visit: &Visit, l: Panel<'_>, pq: Panel<'_>) {
        let mut both = [visit.above_zeros(&self.u), visit.above_zeros(&self.du)];
        l.eliminate(&mut both);
        let [x, mut dx] = both;
        let v = x.subrows(0, visit.width);
        let mut add_half = |of: &Mat<f64>| {
            let into = visit.square(&mut self.sum);
            matmul(into, Accum::Add, v.transpose(), of.subrows(0, visit.width), 0.5, Par::Seq);
        };
        add_half(&dx);
        pq.take_product(v, &mut dx);
        add_half(&dx);
        add_below(self.u.as_mut(), visit, x.as_ref());
        add_below(self.du.as_mut(), visit, dx.as_ref());
    }
}

/// The share of the work before any form that the elimination's derivative is.
const SHARE_OF_ELIMINATION: f64 = 0.7;

/// Puts `P` and `Q` where the elimination's derivative is, supernode by supernode.
fn relate_all(cholesky: &Cholesky, derivative: &mut [f64], go_on: &dyn Fn(f64) -> bool) -> Result<(), SparseError> {
    let shape = cholesky.shape()?;
    let (mut panels, mut rest) = (Vec::new(), derivative);
    for s in 0..shape.symbolic.n_supernodes() {
        let (own, others) = rest.split_at_mut(shape.span(s..s + 1).len());
        panels.push((s, own));
        rest = others;
    }
    let pace = Pace::of(shape.whole_work());
    cholesky.team().each_at_pace(panels, &pace, go_on, |(s, own)| {
        let factor = shape.blocks(s, &cholesky.values()[shape.span(s..s + 1)]);
        relate(factor, MatMut::from_column_major_slice_mut(own, shape.height(s), shape.width(s)));
        pace.step(shape.work(s))
    })?;
    Ok(())
}

/// Puts `P` and `Q` where `G11` and `G21` are.
fn relate((l11, l21): (MatRef<'_, f64>, MatRef<'_, f64>), g: MatMut<'_, f64>) {
    let (mut g11, mut g21) = g.split_at_row_mut(l11.nrows());
    solve_lower_triangular_in_place(l11, g11.as_mut(), Par::Seq);
    solve_lower_triangular_in_place(l11, g11.as_mut().transpose_mut(), Par::Seq);
    solve_lower_triangular_in_place(l11, g21.as_mut().transpose_mut(), Par::Seq);
    matmul(g21, Accum::Add, l21, g11.as_ref(), -1.0, Par::Seq);
}

impl Visit {
    fn own_rows<'a>(&self, of: &'a Mat<f64>) -> MatRef<'a, f64> {
        of.submatrix(self.first, self.columns.start, self.width, self.columns.len())
    }

    /// Its own rows, with nothing below them yet.
    fn above_zeros(&self, of: &Mat<f64>) -> Mat<f64> {
        let mut x = Mat::zeros(self.width + self.below.len(), self.columns.len());
        x.subrows_mut(0, self.width).copy_from(self.own_rows(of));
        x
    }

    fn square<'a>(&self, of: &'a mut Mat<f64>) -> MatMut<'a, f64> {
        let (start, count) = (self.columns.start, self.columns.len());
        of.submatrix_mut(start, start, count, count)
    }
}

/// Adds a change of the rows below to them.
fn add_below(mut to: MatMut<'_, f64>, visit: &Visit, change: MatRef<'_, f64>) {
    for (k, column) in visit.columns.clone().enumerate() {
        for (row, &place) in visit.below.iter().enumerate() {
            to[(place, column)] += change[(visit.width + row, k)];
        }
    }
}
