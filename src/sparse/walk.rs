//! Walks over the elimination tree by a team: from the leaves up, each supernode handing what is left of it to its parent
//! (the multifrontal method, Duff and Reid 1983), and from the roots down.
//!
//! Branches do without each other, so each is one thread's; the top, where they meet, is walked by one, which shares its
//! dense blocks' columns with the others. Every supernode adds up its children in their order, so the result is the same
//! to the last bit however the branches were shared.

use std::ops::Range;

use faer::Mat;

use super::error::SparseError;
use super::team::{Pace, Team};
use super::tree::Shape;

/// A supernode whose children have handed in their updates.
pub(super) struct Front<'f> {
    pub s: usize,
    pub panel: &'f mut [f64],
    /// Between the rows below, the lower triangle: at first the sum of the children's updates, at last its own.
    pub below: &'f mut Mat<f64>,
    pub team: &'f Team,
}

/// Updates that no parent has taken yet.
struct Updates {
    first: usize,
    own: Vec<Option<Mat<f64>>>,
}

impl Updates {
    fn of(supernodes: Range<usize>) -> Self {
        Self { first: supernodes.start, own: supernodes.map(|_| None).collect() }
    }

    fn put(&mut self, s: usize, update: Mat<f64>) {
        self.own[s - self.first] = Some(update);
    }

    fn take(&mut self, s: usize) -> Option<Mat<f64>> {
        self.own[s - self.first].take()
    }

    fn left(self) -> impl Iterator<Item = (usize, Mat<f64>)> {
        let first = self.first;
        self.own.into_iter().enumerate().filter_map(move |(k, update)| Some((first + k, update?)))
    }
}

/// The values, cut where branches begin and end: those of each branch, and those of each supernode of the top.
struct Cut<'v> {
    branches: Vec<&'v mut [f64]>,
    top: Vec<&'v mut [f64]>,
}

impl<'v> Cut<'v> {
    fn of(shape: Shape<'_>, values: &'v mut [f64]) -> Self {
        let mut cut = Self { branches: Vec::new(), top: Vec::new() };
        let (mut rest, mut top) = (values, shape.tree.top().iter().copied().peekable());
        for branch in shape.tree.branches() {
            while let Some(s) = top.next_if(|&s| s < branch.start) {
                cut.top.push(split(&mut rest, shape.span(s..s + 1).len()));
            }
            cut.branches.push(split(&mut rest, shape.span(branch.clone()).len()));
        }
        cut.top.extend(top.map(|s| split(&mut rest, shape.span(s..s + 1).len())));
        cut
    }
}

fn split<'v>(rest: &mut &'v mut [f64], length: usize) -> &'v mut [f64] {
    let (own, others) = std::mem::take(rest).split_at_mut(length);
    *rest = others;
    own
}

/// Eliminates every supernode after its children. `go_on` is told how far it is and says whether to go on.
pub(super) fn up(
    shape: Shape<'_>,
    values: &mut [f64],
    team: &Team,
    go_on: &dyn Fn(f64) -> bool,
    eliminate: impl Fn(Front<'_>) -> Result<(), SparseError> + Sync,
) -> Result<(), SparseError> {
    let pace = Pace::of(shape.whole_work());
    let cut = Cut::of(shape, values);
    let step = |s: usize, panel: &mut [f64], updates: &mut Updates, team: &Team| {
        let rows = shape.below(s).len();
        let mut below = Mat::zeros(rows, rows);
        for &child in shape.tree.children(s) {
            if let Some(update) = updates.take(child) {
                shape.extend_add(s, panel, &mut below, child, &update);
            }
        }
        eliminate(Front { s, panel, below: &mut below, team })?;
        if rows > 0 {
            updates.put(s, below);
        }
        pace.step(shape.work(s))
    };
    let branches = shape.tree.branches().iter().cloned().zip(cut.branches).collect();
    let alone = Team::default();
    let handed = team.each_at_pace(branches, &pace, go_on, |(branch, mut values): (Range<usize>, &mut [f64])| {
        let mut updates = Updates::of(branch.clone());
        for s in branch {
            step(s, split(&mut values, shape.span(s..s + 1).len()), &mut updates, &alone)?;
        }
        Ok(updates)
    })?;
    let mut updates = Updates::of(0..shape.symbolic.n_supernodes());
    handed.into_iter().flat_map(Updates::left).for_each(|(s, update)| updates.put(s, update));
    for (&s, panel) in shape.tree.top().iter().zip(cut.top) {
        step(s, panel, &mut updates, team)?;
        pace.ask_at_times(go_on)?;
    }
    Ok(())
}

/// Visits every supernode before its children, with the matrices between the rows below it and its panels, of `K`
/// matrices at once, which begin at zero. What is not asked for again is not held: nobody but a branch itself reads its
/// panels, so they are let go once `keep` has taken what it wants of them. It is asked for the branches in their order,
/// then for each supernode of the top. `go_on` as in [`up`].
pub(super) fn down<const K: usize, R: Send>(
    shape: Shape<'_>,
    team: &Team,
    go_on: &dyn Fn(f64) -> bool,
    visit: impl Fn(usize, [Mat<f64>; K], [&mut [f64]; K], &Team) + Sync,
    keep: impl Fn(Range<usize>, [&[f64]; K]) -> R + Sync,
) -> Result<Vec<R>, SparseError> {
    let pace = Pace::of(shape.whole_work());
    let zeros = |supernodes: Range<usize>| -> [Vec<f64>; K] {
        std::array::from_fn(|_| vec![0.0; shape.span(supernodes.clone()).len()])
    };
    let list = shape.tree.top();
    let mut top: Vec<[Vec<f64>; K]> = list.iter().map(|&s| zeros(s..s + 1)).collect();
    for (at, &s) in list.iter().enumerate().rev() {
        let (below, above) = top.split_at_mut(at + 1);
        let of_top = |t: usize, k: usize| list[at + 1..].binary_search(&t).map_or(&[][..], |t| &above[t][k][..]);
        let trailing = std::array::from_fn(|k| shape.trailing(s, |t| of_top(t, k)));
        visit(s, trailing, below[at].each_mut().map(|own| &mut own[..]), team);
        pace.step(shape.work(s))?;
        pace.ask_at_times(go_on)?;
    }
    let alone = Team::default();
    let mut kept = team.each_at_pace(shape.tree.branches().to_vec(), &pace, go_on, |branch: Range<usize>| {
        let mut own = zeros(branch.clone());
        let first = shape.span(branch.clone()).start;
        let within = |s: usize| {
            let span = shape.span(s..s + 1);
            span.start - first..span.end - first
        };
        for s in branch.clone().rev() {
            let trailing = std::array::from_fn(|k| {
                shape.trailing(s, |t| match branch.contains(&t) {
                    true => &own[k][within(t)],
                    false => list.binary_search(&t).map_or(&[][..], |at| &top[at][k]),
                })
            });
            visit(s, trailing, own.each_mut().map(|own| &mut own[within(s)]), &alone);
            pace.step(shape.work(s))?;
        }
        Ok(keep(branch, own.each_ref().map(|own| &own[..])))
    })?;
    kept.extend(list.iter().zip(&top).map(|(&s, own)| keep(s..s + 1, own.each_ref().map(|own| &own[..]))));
    Ok(kept)
}
