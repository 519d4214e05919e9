//! Right-hand sides on their way up the elimination tree, and the products of what they become.
//!
//! Columns do not know of each other until they are multiplied, so a group of them walks by itself, on any thread; then a
//! stripe of the product is anyone's, too. Groups are the same whoever walks them, and so are the bytes.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::error::SparseError;
use super::few::{FEW, Panel};
use super::pace::Pace;
use super::team::Team;
use super::tree::Tree;

/// Columns that walk together: as many as make use of a panel once it has been fetched.
const GROUP: usize = 128;

/// An entry of a right-hand side.
pub(super) struct Entry {
    pub column: usize,
    /// When its unknown is eliminated.
    pub step: usize,
    pub value: f64,
}

/// A supernode's columns of the factor and, for a sandwich, its `P` and `Q`.
pub(super) struct Panels<'a> {
    pub factor: Panel<'a>,
    pub derivative: Option<Panel<'a>>,
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
    columns: Range<usize>,
}

/// The supernodes on the paths, children before parents.
pub(super) struct Ascent {
    visits: Vec<Visit>,
    rows: usize,
    columns: usize,
    /// Where every entry lies among all paths' rows.
    places: Vec<usize>,
}

/// Both sides on so many rows, and the sum as it is formed, put back in order and handed on.
pub(super) fn bytes(rows: usize, columns: usize) -> usize {
    8 * columns * (2 * rows + 3 * columns)
}

impl Ascent {
    /// The paths of so many columns' entries; columns that begin near each other should stand near each other.
    pub fn of(tree: &Tree, entries: &[Entry], count: usize) -> Self {
        let owner = tree.owner();
        let mut columns: Vec<Option<(usize, usize)>> = vec![None; tree.supernodes()];
        let widen = |range: &mut Option<(usize, usize)>, (low, high): (usize, usize)| {
            *range = Some(range.map_or((low, high), |(a, b)| (a.min(low), b.max(high))));
        };
        entries.iter().for_each(|own| widen(&mut columns[owner[own.step]], (own.column, own.column + 1)));
        let (mut firsts, mut rows) = (vec![0; tree.supernodes()], 0);
        for s in 0..tree.supernodes() {
            let Some(range) = columns[s] else { continue };
            firsts[s] = rows;
            rows += tree.width(s);
            if let Some(parent) = tree.parent(s) {
                widen(&mut columns[parent], range);
            }
        }
        let place = |step: usize| firsts[owner[step]] + step - tree.first(owner[step]);
        let visit = |(s, range): (usize, &Option<(usize, usize)>)| {
            let (low, high) = (*range)?;
            let below = tree.below(s).iter().map(|&step| place(step)).collect();
            Some(Visit { supernode: s, first: firsts[s], width: tree.width(s), below, columns: low..high })
        };
        let visits = columns.iter().enumerate().filter_map(visit).collect();
        Self { visits, rows, columns: count, places: entries.iter().map(|own| place(own.step)).collect() }
    }

    /// Bytes that [`Ascent::products`] holds.
    pub fn bytes(&self) -> usize {
        bytes(self.rows, self.columns)
    }

    /// `V^T V`, of which the lower triangle is formed, or, with derivatives, `V^T F`; see `paths`.
    pub fn products<'a>(
        &self,
        entries: &[Entry],
        panels: &(impl Fn(usize) -> Panels<'a> + Sync),
        team: &Team,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Mat<f64>, SparseError> {
        let dual = self.visits.first().is_some_and(|visit| panels(visit.supernode).derivative.is_some());
        let mut v = Mat::zeros(self.rows, self.columns);
        entries.iter().zip(&self.places).for_each(|(own, &place)| v[(place, own.column)] += own.value);
        let mut f = Mat::zeros(if dual { self.rows } else { 0 }, self.columns);

        let pace = Pace::of(self.walking());
        let groups = in_groups(v.as_mut()).zip(in_groups(f.as_mut()));
        let groups = groups.map(|((range, v), (_, f))| Group { range, v, f, scratch: Vec::new() }).collect();
        team.each_at_pace(groups, &pace, &|_| go_on(), |mut group: Group<'_>| {
            self.visits.iter().try_for_each(|visit| {
                group.pass(visit, &panels(visit.supernode));
                pace.step(visit.walking(&group.range))
            })
        })?;

        let mut sum = Mat::zeros(self.columns, self.columns);
        let pace = Pace::of(self.multiplying());
        let (v, right) = (v.as_ref(), if dual { f.as_ref() } else { v.as_ref() });
        team.each_at_pace(in_groups(sum.as_mut()).collect(), &pace, &|_| go_on(), |(range, mut stripe)| {
            self.visits.iter().try_for_each(|visit| {
                visit.multiply(v, right, &range, dual, &mut stripe);
                pace.step(visit.multiplying(&range))
            })
        })?;
        Ok(sum)
    }

    /// Multiply-adds, about.
    fn walking(&self) -> f64 {
        self.visits.iter().map(|visit| visit.walking(&(0..self.columns))).sum()
    }

    fn multiplying(&self) -> f64 {
        self.visits.iter().map(|visit| visit.multiplying(&(0..self.columns))).sum()
    }
}

impl Visit {
    /// Which of these columns pass here.
    fn among(&self, columns: &Range<usize>) -> Range<usize> {
        let start = self.columns.start.max(columns.start);
        start..self.columns.end.min(columns.end).max(start)
    }

    fn walking(&self, columns: &Range<usize>) -> f64 {
        let panel = self.width * (self.width + self.below.len());
        (3 * panel * self.among(columns).len()) as f64
    }

    fn multiplying(&self, columns: &Range<usize>) -> f64 {
        (self.width * self.columns.len() * self.among(columns).len()) as f64
    }

    /// Adds this supernode's share to the columns `range` of the product.
    fn multiply(
        &self,
        v: MatRef<'_, f64>,
        right: MatRef<'_, f64>,
        range: &Range<usize>,
        whole: bool,
        stripe: &mut MatMut<'_, f64>,
    ) {
        let own = self.among(range);
        if own.is_empty() {
            return;
        }
        let rows = if whole { self.columns.clone() } else { own.start..self.columns.end };
        let left = v.submatrix(self.first, rows.start, self.width, rows.len());
        let right = right.submatrix(self.first, own.start, self.width, own.len());
        let into = stripe.as_mut().submatrix_mut(rows.start, own.start - range.start, rows.len(), own.len());
        matmul(into, Accum::Add, left.transpose(), right, 1.0, Par::Seq);
    }
}

/// Columns that walk together: what their right-hand sides and those' derivatives become, `V` and `F` where they have
/// passed.
struct Group<'a> {
    range: Range<usize>,
    v: MatMut<'a, f64>,
    f: MatMut<'a, f64>,
    /// What goes to the rows below, kept from visit to visit: memory that is new each time is cleared by the system first.
    scratch: Vec<f64>,
}

impl Group<'_> {
    fn pass(&mut self, visit: &Visit, panels: &Panels<'_>) {
        let columns = visit.among(&self.range);
        if columns.is_empty() {
            return;
        }
        let own = columns.start - self.range.start..columns.end - self.range.start;
        if own.len() > FEW {
            return self.pass_many(visit, panels, &own);
        }
        let Some(derivative) = panels.derivative else {
            let mut sides = [above_zeros(self.v.as_ref(), visit, &own)];
            panels.factor.eliminate(&mut sides);
            return put_back(&mut self.v, visit, &own, sides[0].as_ref());
        };
        let mut sides = [above_zeros(self.v.as_ref(), visit, &own), above_zeros(self.f.as_ref(), visit, &own)];
        panels.factor.eliminate(&mut sides);
        let [v, mut f] = sides;
        let before = f.subrows(0, visit.width).to_owned();
        derivative.take_product(v.subrows(0, visit.width), &mut f);
        let mut own_rows = f.subrows_mut(0, visit.width);
        own_rows += before;
        put_back(&mut self.v, visit, &own, v.as_ref());
        put_back(&mut self.f, visit, &own, f.as_ref());
    }

    /// The same with kernels made for many columns.
    fn pass_many(&mut self, visit: &Visit, panels: &Panels<'_>, columns: &Range<usize>) {
        let Self { v, f, scratch, .. } = self;
        let (rows, width) = (visit.below.len(), columns.len());
        scratch.resize(scratch.len().max(rows * width), 0.0);
        let mut below = MatMut::from_column_major_slice_mut(&mut scratch[..rows * width], rows, width);
        let (l11, l21) = panels.factor.blocks();
        let mut own_v = own_rows(v, visit, columns);
        solve_lower_triangular_in_place(l11, own_v.as_mut(), Par::Seq);
        matmul(below.as_mut(), Accum::Replace, l21, own_v.as_ref(), 1.0, Par::Seq);
        take_below(v, visit, columns, below.as_ref());
        let Some(derivative) = panels.derivative else { return };
        let (p, q) = derivative.blocks();
        let own_v = own_rows(v, visit, columns);
        let mut own_f = own_rows(f, visit, columns);
        solve_lower_triangular_in_place(l11, own_f.as_mut(), Par::Seq);
        matmul(below.as_mut(), Accum::Replace, l21, own_f.as_ref(), 1.0, Par::Seq);
        matmul(below.as_mut(), Accum::Add, q, own_v.as_ref(), 1.0, Par::Seq);
        own_f *= 2.0;
        matmul(own_f, Accum::Add, p, own_v.as_ref(), -1.0, Par::Seq);
        take_below(f, visit, columns, below.as_ref());
    }
}

/// A supernode's own rows of some columns.
fn own_rows<'a>(of: &'a mut MatMut<'_, f64>, visit: &Visit, columns: &Range<usize>) -> MatMut<'a, f64> {
    of.as_mut().submatrix_mut(visit.first, columns.start, visit.width, columns.len())
}

/// Takes what a supernode has for the rows below it from them.
fn take_below(from: &mut MatMut<'_, f64>, visit: &Visit, columns: &Range<usize>, x: MatRef<'_, f64>) {
    for (k, column) in columns.clone().enumerate() {
        for (row, &place) in visit.below.iter().enumerate() {
            from[(place, column)] -= x[(row, k)];
        }
    }
}

/// A supernode's own rows of some columns, with nothing below them yet.
fn above_zeros(of: MatRef<'_, f64>, visit: &Visit, columns: &Range<usize>) -> Mat<f64> {
    let mut x = Mat::zeros(visit.width + visit.below.len(), columns.len());
    x.subrows_mut(0, visit.width).copy_from(of.submatrix(visit.first, columns.start, visit.width, columns.len()));
    x
}

/// Puts a supernode's own rows where they were, and adds what is left to the rows below.
fn put_back(to: &mut MatMut<'_, f64>, visit: &Visit, columns: &Range<usize>, x: MatRef<'_, f64>) {
    let (own, below) = x.split_at_row(visit.width);
    to.as_mut().submatrix_mut(visit.first, columns.start, visit.width, columns.len()).copy_from(own);
    for (k, column) in columns.clone().enumerate() {
        for (row, &place) in visit.below.iter().enumerate() {
            to[(place, column)] += below[(row, k)];
        }
    }
}

/// Columns in groups of [`GROUP`], and which they are.
fn in_groups(of: MatMut<'_, f64>) -> impl Iterator<Item = (Range<usize>, MatMut<'_, f64>)> {
    let count = of.ncols();
    let mut rest = Some(of);
    (0..count).step_by(GROUP).map_while(move |start| {
        let width = GROUP.min(count - start);
        let (group, others) = rest.take()?.split_at_col_mut(width);
        rest = Some(others);
        Some((start..start + width, group))
    })
}
