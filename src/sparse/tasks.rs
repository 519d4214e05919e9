//! What a factorisation is made of, as pieces of work and what they hand on: what a plan of who does which is made from.
//!
//! A branch of the elimination tree is one task, as it is one thread's; above the branches every supernode is one. A task
//! needs what its children hand on, the update between the rows below them (Duff and Reid 1983), and nothing else.

use super::cholesky::Cholesky;
use super::division::Division;
use super::parcel::triangle;

/// A branch, or a supernode above the branches.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// Multiply-adds, about.
    pub work: f64,
    /// Entries of its part of the factor.
    pub entries: usize,
    /// Entries of the updates that it hands on: lower triangles.
    pub update: usize,
    /// The tasks that need what it hands on; ascending, all later than itself.
    pub needed_by: Vec<usize>,
    /// Whether it is a branch.
    pub branch: bool,
}

impl Cholesky {
    /// The tasks of a factorisation, children before parents.
    pub fn tasks(&self) -> Vec<Task> {
        let tree = self.tree();
        let Division { branches, top } = self.division();
        let branches = branches.iter().map(|range| (range.clone(), true));
        let mut groups: Vec<_> = branches.chain(top.iter().map(|&s| (s..s + 1, false))).collect();
        groups.sort_by_key(|(range, _)| range.start);
        let task_of = |s: usize| groups.partition_point(|(range, _)| range.start <= s) - 1;
        let tasks = groups.iter().map(|(range, branch)| {
            let mut needed_by: Vec<usize> =
                tree.handing_on(range).filter_map(|s| tree.parent(s)).map(task_of).collect();
            needed_by.dedup();
            Task {
                work: tree.work_of(range.clone()),
                entries: tree.span(range.clone()).len(),
                update: tree.handing_on(range).map(|s| triangle(tree.below(s).len())).sum(),
                needed_by,
                branch: *branch,
            }
        });
        tasks.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::cholesky::tests::random_spd;
    use super::*;
    use crate::sparse::Pattern;

    #[test]
    fn tasks_are_all_of_the_factor_and_hand_on_upwards() {
        let matrix = random_spd([90, 70], 2);
        let cholesky = Cholesky::analyse(&Pattern::of_stencil(matrix.stencil())).unwrap();
        let tasks = cholesky.tasks();
        assert_eq!(tasks.iter().map(|task| task.entries).sum::<usize>(), cholesky.fill());
        let tree = cholesky.tree();
        let work: f64 = tasks.iter().map(|task| task.work).sum();
        assert!((work / tree.whole_work() - 1.0).abs() < 1e-12);
        assert_eq!(tasks.iter().filter(|task| task.branch).count(), cholesky.division().branches.len());
        for (k, task) in tasks.iter().enumerate() {
            assert!(task.needed_by.iter().all(|&parent| parent > k && !tasks[parent].branch));
            assert_eq!(task.update == 0, task.needed_by.is_empty());
        }
        assert_eq!(tasks.last().unwrap().update, 0);
    }
}
