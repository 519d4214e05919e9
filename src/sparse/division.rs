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
        // A subtree need not be one range: pieces of a separator that do not touch take turns in the order of elimination.
        let (mut first, mut size): (Vec<usize>, _) = ((0..tree.supernodes()).collect(), vec![1; tree.supernodes()]);
        for s in 0..tree.supernodes() {
            for &child in tree.children(s) {
                (first[s], size[s]) = (first[s].min(first[child]), size[s] + size[child]);
            }
        }
        let whole = |s: usize| first[s]..s + 1;
        let is_one = |range: &Range<usize>| range.len() == size[range.end - 1];
        let mut open: Vec<_> = (0..tree.supernodes()).filter(|&s| tree.parent(s).is_none()).map(whole).collect();
        let mut small = Vec::new();
        while let Some(range) = open.pop() {
            match of(&range) > most || !is_one(&range) {
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

    /// Every supernode is in one branch or in the top, and a branch has all that hand updates to it.
    fn assert_divided(tree: &Tree) {
        let Division { branches, top } = Division::coarse(tree);
        assert!(branches.iter().all(|branch| tree.is_closed(branch)), "{branches:?}");
        let mut all: Vec<usize> = branches.iter().cloned().flatten().chain(top.iter().copied()).collect();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..tree.supernodes()), "{branches:?}");
    }

    /// Aisles, pillars, islands: where pieces of separators do not touch, subtrees are not always one range.
    #[test]
    fn places_with_gaps_are_divided_too() {
        type IsIn = fn(usize, usize) -> bool;
        let places: [(&str, IsIn); 5] = [
            ("aisles", |i, j| !(4..116).contains(&j) || i % 14 < 6),
            ("aisles across", |i, j| !(4..116).contains(&i) || j % 14 < 6),
            ("islands", |i, j| i % 40 < 30 && j % 40 < 30),
            ("pillars", |i, j| !(10..18).contains(&(i % 24)) || !(10..18).contains(&(j % 24))),
            ("a diagonal", |i, j| i.abs_diff(j) < 9 || (i + j).abs_diff(120) < 9),
        ];
        let bounds = crate::geometry::Bounds { min: [0.0, 0.0], max: [117.0, 117.0] };
        let lattice = crate::spline::Lattice::covering(&bounds, 1.0, 1_000_000).unwrap();
        let [nx, ny] = lattice.control_points();
        for (name, is_in) in places {
            let active: Vec<bool> = (0..nx * ny).map(|p| is_in(p % nx, p / nx)).collect();
            let poses = [0, 12].map(|poses| {
                let near = |pose: usize| (0..nx * ny).filter(move |p| (p % nx).abs_diff(10 * pose) < 8);
                let views = Views::of(poses, (0..poses).flat_map(|pose| near(pose).map(move |p| (pose, p))));
                Pattern::new(Stencil::over(&lattice, active.clone()), 2, views)
            });
            for pattern in poses {
                let cholesky = Cholesky::analyse(&pattern).unwrap();
                assert_divided(cholesky.tree());
                println!("{name}: {:?}", Division::coarse(cholesky.tree()).branches);
            }
        }
    }

    #[test]
    fn coarse_branches_are_few_whole_and_leave_little() {
        let patterns = [Pattern::new(Stencil::of_grid([120, 120]), 2, Views::of(0, [])), seen_place()];
        for (pattern, least_of_work) in patterns.iter().zip([0.75, 0.5]) {
            assert_divided(Cholesky::analyse(pattern).unwrap().tree());
            let cholesky = Cholesky::analyse(pattern).unwrap();
            let tree = cholesky.tree();
            let Division { branches, top } = Division::coarse(tree);
            assert!((2..=6).contains(&branches.len()), "{branches:?}");
            assert!(!top.is_empty());
            let work: Vec<f64> = branches.iter().map(|own| tree.work_of(own.clone()) / tree.whole_work()).collect();
            assert!(work.iter().all(|share| *share <= SHARE) && work.iter().sum::<f64>() > least_of_work, "{work:?}");
        }
    }
}
