//! Walks over the elimination tree by a team: from the leaves up, each supernode handing what is left of it to its parent
//! (the multifrontal method, Duff and Reid 1983), and from the roots down.
//!
//! Branches do without each other, so each is one thread's, here or elsewhere ([`super::abroad`]); the top, where they meet,
//! is walked by one, which shares its dense blocks' columns with the others. Every supernode adds up its children in their
//! order, so the result is the same to the last bit however the branches were shared.

use std::ops::Range;

use faer::Mat;

use super::division::Division;
use super::error::SparseError;
use super::pace::Pace;
use super::packing::Matter;
use super::parcel::{Answer, Parcel, columns, triangle};
use super::shared::Post;
use super::team::Team;
use super::tree::Tree;

/// A tree, and how it is divided among those who walk it.
pub(super) type Divided<'d> = (&'d Tree, &'d Division);

/// A supernode whose children have handed in their updates.
pub(super) struct Front<'f> {
    pub s: usize,
    pub panel: &'f mut [f64],
    /// Between the rows below, the lower triangle: at first the sum of the children's updates, at last its own.
    pub below: &'f mut Mat<f64>,
    pub team: &'f Team,
}

/// What a walk reads beside the values that it changes: the factor's, and the elimination's derivative; none where it does
/// without.
#[derive(Clone, Copy, Default)]
pub(super) struct Sources<'s> {
    pub factor: &'s [f64],
    pub derivative: &'s [f64],
}

impl<'s> Sources<'s> {
    /// What a branch needs of them.
    fn within(self, span: &Range<usize>) -> [&'s [f64]; 2] {
        [self.factor, self.derivative].map(|all| all.get(span.clone()).unwrap_or_default())
    }
}

/// What a walk up does with a front.
pub(super) trait Upward: Sync {
    fn visit(&self, tree: &Tree, front: Front<'_>) -> Result<(), SparseError>;

    fn sources(&self) -> Sources<'_> {
        Sources::default()
    }
}

/// What a walk down does with a supernode: with the matrices between the rows below it, it fills its panels, of `K`
/// matrices.
pub(super) trait Downward<const K: usize>: Sync {
    fn visit(&self, tree: &Tree, s: usize, trailing: [Mat<f64>; K], own: [&mut [f64]; K], team: &Team);

    fn sources(&self) -> Sources<'_>;
}

/// Updates that no parent has taken yet, of a range of supernodes.
pub(super) struct Updates {
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

    pub fn left(self) -> impl Iterator<Item = (usize, Mat<f64>)> {
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
    fn of((tree, division): Divided<'_>, values: &'v mut [f64]) -> Self {
        let mut cut = Self { branches: Vec::new(), top: Vec::new() };
        let (mut rest, mut top) = (values, division.top.iter().copied().peekable());
        for branch in &division.branches {
            while let Some(s) = top.next_if(|&s| s < branch.start) {
                cut.top.push(split(&mut rest, tree.span(s..s + 1).len()));
            }
            cut.branches.push(split(&mut rest, tree.span(branch.clone()).len()));
        }
        cut.top.extend(top.map(|s| split(&mut rest, tree.span(s..s + 1).len())));
        cut
    }
}

fn split<'v>(rest: &mut &'v mut [f64], length: usize) -> &'v mut [f64] {
    let (own, others) = std::mem::take(rest).split_at_mut(length);
    *rest = others;
    own
}

/// One supernode on the way up: takes its children's updates, and leaves its own.
fn step(
    tree: &Tree,
    (s, panel): (usize, &mut [f64]),
    updates: &mut Updates,
    pass: &impl Upward,
    team: &Team,
) -> Result<(), SparseError> {
    let rows = tree.below(s).len();
    let mut below = Mat::zeros(rows, rows);
    for &child in tree.children(s) {
        if let Some(update) = updates.take(child) {
            tree.extend_add(s, panel, &mut below, child, &update);
        }
    }
    pass.visit(tree, Front { s, panel, below: &mut below, team })?;
    if rows > 0 {
        updates.put(s, below);
    }
    Ok(())
}

/// A branch on the way up, and the updates that it hands on.
pub(super) fn branch_up(
    tree: &Tree,
    branch: Range<usize>,
    mut values: &mut [f64],
    pass: &impl Upward,
    pace: &Pace,
) -> Result<Updates, SparseError> {
    let mut updates = Updates::of(branch.clone());
    for s in branch {
        let panel = split(&mut values, tree.span(s..s + 1).len());
        step(tree, (s, panel), &mut updates, pass, &Team::alone())?;
        pace.step(tree.work(s))?;
    }
    Ok(updates)
}

/// Eliminates every supernode after its children. `go_on` is told how far it is and says whether to go on.
pub(super) fn up(
    (tree, division): Divided<'_>,
    values: &mut [f64],
    team: &Team,
    go_on: &dyn Fn(f64) -> bool,
    pass: &impl Upward,
) -> Result<(), SparseError> {
    type Item<'v> = (Range<usize>, &'v mut [f64]);
    let pace = Pace::of(tree.whole_work());
    let cut = Cut::of((tree, division), values);
    let branches: Vec<Item<'_>> = division.branches.iter().cloned().zip(cut.branches).collect();
    let post = Post {
        work: &|k| tree.work_of(division.branches[k].clone()),
        parcel: &|(branch, values): &Item<'_>| {
            let sources = pass.sources().within(&tree.span(branch.clone()));
            Parcel::of(tree, branch.clone(), Matter::Up(values), sources)
        },
        accept: &|(branch, values): &mut Item<'_>, answer: Answer| accepted(tree, branch.clone(), values, &answer),
    };
    let handed = team.each_anywhere(branches, &pace, go_on, &post, |(branch, values): Item<'_>| {
        branch_up(tree, branch, values, pass, &pace)
    })?;
    let mut updates = Updates::of(0..tree.supernodes());
    handed.into_iter().flat_map(Updates::left).for_each(|(s, update)| updates.put(s, update));
    for (&s, panel) in division.top.iter().zip(cut.top) {
        step(tree, (s, panel), &mut updates, pass, team)?;
        pace.step(tree.work(s))?;
        pace.ask_at_times(go_on)?;
    }
    Ok(())
}

/// What another made of a branch: its panels, and what it hands on. None where the answer is not one to this question.
fn accepted(tree: &Tree, branch: Range<usize>, values: &mut [f64], answer: &Answer) -> Option<Updates> {
    let handing: Vec<usize> = tree.handing_on(&branch).collect();
    let entries = handing.iter().map(|&s| triangle(tree.below(s).len())).sum::<usize>();
    if answer.values.len() != values.len() || answer.handed_on.len() != entries {
        return None;
    }
    values.copy_from_slice(&answer.values);
    let (mut updates, mut rest) = (Updates::of(branch), &answer.handed_on[..]);
    for s in handing {
        let rows = tree.below(s).len();
        let (own, others) = rest.split_at(triangle(rows));
        let mut update = Mat::zeros(rows, rows);
        for (column, values) in columns(own, rows).enumerate() {
            update.col_as_slice_mut(column)[column..].copy_from_slice(values);
        }
        rest = others;
        updates.put(s, update);
    }
    Some(updates)
}

/// A branch on the way down: of its panels, the values at the places `wanted`. `above` has the panels of those that own
/// rows outside.
pub(super) fn branch_down<'v, const K: usize>(
    tree: &Tree,
    branch: Range<usize>,
    above: &(impl Fn(usize, usize) -> &'v [f64] + Sync),
    wanted: &[u32],
    pass: &impl Downward<K>,
    pace: &Pace,
) -> Result<Vec<[f64; K]>, SparseError> {
    let mut own = zeros::<K>(tree, branch.clone());
    let first = tree.span(branch.clone()).start;
    let within = |s: usize| {
        let span = tree.span(s..s + 1);
        span.start - first..span.end - first
    };
    for s in branch.clone().rev() {
        let trailing = std::array::from_fn(|k| {
            tree.trailing(s, |t| match branch.contains(&t) {
                true => &own[k][within(t)],
                false => above(t, k),
            })
        });
        pass.visit(tree, s, trailing, own.each_mut().map(|own| &mut own[within(s)]), &Team::alone());
        pace.step(tree.work(s))?;
    }
    Ok(at(wanted, own.each_ref().map(|own| &own[..])))
}

/// Visits every supernode before its children, with the matrices between the rows below it and its panels, of `K`
/// matrices at once, which begin at zero. What is not asked for again is not held: nobody but a branch itself reads its
/// panels, so they are let go once what is wanted of them was taken: the values at these places of the branches in their
/// order, then of each supernode of the top. `go_on` as in [`up`].
pub(super) fn down<'w, const K: usize>(
    (tree, division): Divided<'_>,
    team: &Team,
    go_on: &dyn Fn(f64) -> bool,
    pass: &impl Downward<K>,
    wanted: &(impl Fn(Range<usize>) -> &'w [u32] + Sync),
) -> Result<Vec<Vec<[f64; K]>>, SparseError> {
    let pace = Pace::of(tree.whole_work());
    let list = &division.top;
    let mut top: Vec<[Vec<f64>; K]> = list.iter().map(|&s| zeros(tree, s..s + 1)).collect();
    for (at, &s) in list.iter().enumerate().rev() {
        let (below, above) = top.split_at_mut(at + 1);
        let of_top = |t: usize, k: usize| list[at + 1..].binary_search(&t).map_or(&[][..], |t| &above[t][k][..]);
        let trailing = std::array::from_fn(|k| tree.trailing(s, |t| of_top(t, k)));
        pass.visit(tree, s, trailing, below[at].each_mut().map(|own| &mut own[..]), team);
        pace.step(tree.work(s))?;
        pace.ask_at_times(go_on)?;
    }
    let above = |t: usize, k: usize| list.binary_search(&t).map_or(&[][..], |at| &top[at][k][..]);
    let post = Post {
        work: &|k| tree.work_of(division.branches[k].clone()),
        parcel: &|branch: &Range<usize>| {
            let sources = pass.sources().within(&tree.span(branch.clone()));
            let matter = Matter::Down { above: &above, matrices: K, wanted: wanted(branch.clone()) };
            Parcel::of(tree, branch.clone(), matter, sources)
        },
        accept: &|branch: &mut Range<usize>, answer: Answer| {
            let count = wanted(branch.clone()).len();
            let (values, rest) = answer.values.as_chunks::<K>();
            (values.len() == count && rest.is_empty()).then(|| values.to_vec())
        },
    };
    let mut kept = team.each_anywhere(division.branches.clone(), &pace, go_on, &post, |branch: Range<usize>| {
        let places = wanted(branch.clone());
        branch_down(tree, branch, &above, places, pass, &pace)
    })?;
    kept.extend(list.iter().zip(&top).map(|(&s, own)| at(wanted(s..s + 1), own.each_ref().map(|own| &own[..]))));
    Ok(kept)
}

fn zeros<const K: usize>(tree: &Tree, supernodes: Range<usize>) -> [Vec<f64>; K] {
    std::array::from_fn(|_| vec![0.0; tree.span(supernodes.clone()).len()])
}

/// The values at these places.
fn at<const K: usize>(places: &[u32], values: [&[f64]; K]) -> Vec<[f64; K]> {
    places.iter().map(|&place| values.map(|own| own[place as usize])).collect()
}
