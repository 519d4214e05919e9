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
//! v = L11^-1 u,                 dv = L11^-1 du,  f = 2 dv - P v
//! H^-1 += v^T v,                S -= v^T f / 2 and its transpose
//! u2   -= L21 v,                du2 -= L21 dv + Q v                rows below
//! ```
//!
//! `P` and `Q` stand where the derivative stood, so a walk reads both panels once. With few columns that is all the time it takes.

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::ascent::{Ascent, Entry, Panels, bytes};
use super::cholesky::Cholesky;
use super::error::SparseError;
use super::pace::Pace;
use super::selected::eliminate_derivative;
use super::system::SystemMatrix;
use super::team::Team;

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
        let (tree, inverse) = (self.cholesky.tree(), self.cholesky.steps());
        let entries: Vec<Entry> = columns.iter().enumerate().flat_map(|(k, own)| entries(k, own, inverse)).collect();
        Ok(Ascent::of(tree, &entries, columns.len()).bytes())
    }

    /// The forms `E^T H^-1 E`, or those of the sandwich, of columns `E` of few unknowns each, in their order, by a
    /// team. `go_on` says whether to go on.
    pub fn forms<C: AsRef<[(usize, f64)]>>(
        &self,
        columns: &[C],
        of: Of,
        team: &Team,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Mat<f64>, SparseError> {
        let (tree, inverse) = (self.cholesky.tree(), self.cholesky.steps());
        let first = |column: &C| column.as_ref().iter().map(|(unknown, _)| inverse[*unknown]).min();
        let mut order: Vec<usize> = (0..columns.len()).collect();
        order.sort_by_key(|&k| first(&columns[k]));
        let entries: Vec<Entry> =
            order.iter().enumerate().flat_map(|(column, &k)| entries(column, &columns[k], inverse)).collect();
        let ascent = Ascent::of(tree, &entries, columns.len());
        let panels = |supernode: usize| Panels {
            factor: tree.panel(supernode, self.cholesky.values()),
            derivative: (of == Of::Sandwich).then(|| tree.panel(supernode, &self.related)),
        };
        let sum = ascent.products(&entries, &panels, team, go_on)?;
        let mut back = vec![0; columns.len()];
        order.iter().enumerate().for_each(|(sorted, &asked)| back[asked] = sorted);
        let entry = |a: usize, b: usize| match of {
            Of::Inverse => sum[(a.max(b), a.min(b))],
            Of::Sandwich => -0.5 * (sum[(a, b)] + sum[(b, a)]),
        };
        Ok(Mat::from_fn(back.len(), back.len(), |a, b| entry(back[a], back[b])))
    }
}

fn entries<'a, C: AsRef<[(usize, f64)]>>(
    column: usize,
    own: &'a C,
    inverse: &'a [usize],
) -> impl Iterator<Item = Entry> + 'a {
    own.as_ref().iter().map(move |&(unknown, value)| Entry { column, step: inverse[unknown], value })
}

/// The share of the work before any form that the elimination's derivative is.
const SHARE_OF_ELIMINATION: f64 = 0.7;

/// Puts `P` and `Q` where the elimination's derivative is, supernode by supernode.
fn relate_all(cholesky: &Cholesky, derivative: &mut [f64], go_on: &dyn Fn(f64) -> bool) -> Result<(), SparseError> {
    let tree = cholesky.tree();
    let (mut panels, mut rest) = (Vec::new(), derivative);
    for s in 0..tree.supernodes() {
        let (own, others) = rest.split_at_mut(tree.span(s..s + 1).len());
        panels.push((s, own));
        rest = others;
    }
    let pace = Pace::of(tree.whole_work());
    cholesky.team().each_at_pace(panels, &pace, go_on, |(s, own)| {
        let factor = tree.blocks(s, &cholesky.values()[tree.span(s..s + 1)]);
        relate(factor, MatMut::from_column_major_slice_mut(own, tree.height(s), tree.width(s)));
        pace.step(tree.work(s))
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
