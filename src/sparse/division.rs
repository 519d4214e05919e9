//! How an elimination tree is divided: branches, which do without each other, and the top, where they meet.
//!
//! Many threads get fine branches, those of the dissection, and share the dense blocks of the top. Where they are few a large
//! top costs more than it brings, and others elsewhere have no part in it: they get coarse branches. In a building of 144
//! rooms a third of a factorisation is the top's with branches of an eighth of the lattice, with quarters a tenth, and two
//! threads take 43 s with these where they take 47 s with those. What is computed does not depend on it.

use std::ops::Range;

use super::tree::Tree;

/// The largest share of all work that a coarse branch may be: of a dissection, quarters.
const SHARE: f64 = 0.3;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Division {
    /// Ranges of supernodes, each with all that hand updates to it; ascending.
    pub branches: Vec<Range<usize>>,
    /// The supernodes that are in none, ascending.
    pub top: Vec<usize>,
}

impl Division {
    /// Branches that eliminate so many steps each, as far as they are ones.
    pub fn fine(tree: &Tree, steps: &[Range<usize>]) -> Self {
        let branches = steps.iter().map(|steps| tree.within(steps));
        Self::of(tree, branches.filter(|range| !range.is_empty() && tree.is_closed(range)).collect())
    }

    /// Subtrees with at most [`SHARE`] of all work, and neighbours together that have no more.
    pub fn coarse(tree: &Tree) -> Self {
        let mut work = vec![0.0];
        (0..tree.supernodes()).for_each(|s| work.push(work[s] + tree.work(s)));
        let of = |range: &Range<usize>| work[range.end] - work[range.start];
        let most = SHARE * work[tree.supernodes()];
        let mut first: Vec<usize> = (0..tree.supernodes()).collect();
        (0..tree.supernodes()).for_each(|s| first[s] = tree.children(s).first().map_or(s, |&child| first[child]));
        let whole = |s: usize| first[s]..s + 1;
        let mut open: Vec<_> = (0..tree.supernodes()).filter(|&s| tree.parent(s).is_none()).map(whole).collect();
        let mut small = Vec::new();
        while let Some(range) = open.pop() {
            match of(&range) > most {
                true => open.extend(tree.children(range.end - 1).iter().map(|&child| whole(child))),
                false => small.push(range),
            }
        }
        small.sort_by_key(|range| range.start);
        let mut branches: Vec<Range<usize>> = Vec::new();
        for range in small {
            match branches.last_mut() {
                Some(last) if last.end == range.start && of(&(last.start..range.end)) <= most => last.end = range.end,
                _ => branches.push(range),
            }
        }
        Self::of(tree, branches)
    }

    fn of(tree: &Tree, branches: Vec<Range<usize>>) -> Self {
        let mut top = Vec::new();
        let mut next = 0;
        for branch in &branches {
            top.extend(next..branch.start);
            next = branch.end;
        }
        top.extend(next..tree.supernodes());
        Self { branches, top }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::selected::tests::seen_place;
    use crate::sparse::{Cholesky, Pattern, Stencil, Views};

    #[test]
    fn coarse_branches_are_few_whole_and_leave_little() {
        let patterns = [Pattern::new(Stencil::of_grid([120, 120]), 2, Views::of(0, [])), seen_place()];
        for (pattern, least_of_work) in patterns.iter().zip([0.75, 0.5]) {
            let cholesky = Cholesky::analyse(pattern).unwrap();
            let tree = cholesky.tree();
            let Division { branches, top } = Division::coarse(tree);
            assert!((2..=6).contains(&branches.len()), "{branches:?}");
            assert!(branches.iter().all(|branch| tree.is_closed(branch)));
            let mut all: Vec<usize> = branches.iter().cloned().flatten().chain(top.iter().copied()).collect();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..tree.supernodes()));
            let work: Vec<f64> = branches.iter().map(|own| tree.work_of(own.clone()) / tree.whole_work()).collect();
            assert!(work.iter().all(|share| *share <= SHARE) && work.iter().sum::<f64>() > least_of_work, "{work:?}");
        }
    }
}
