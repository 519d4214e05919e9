//! The elimination tree of a supernodal factor: which supernode hands its update to which, where entries lie, and which
//! parts of the tree do without the others.
//!
//! A supernode's columns share their rows, so they lie in one dense panel: its pivot rows, then the rows below, whose
//! matrix among themselves lies in the panels of supernodes eliminated later. [`Shape::trailing`] gathers that matrix,
//! [`Shape::extend_add`] hands a child's update to its parent (Duff and Reid 1983); both find rows by one walk over two
//! ascending lists.

use std::ops::Range;

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::{Mat, MatRef};

use super::dense::mirror;
use super::few::Panel;

/// Who eliminates what, and for whom.
pub(super) struct Tree {
    /// The supernode that eliminates each step.
    owner: Vec<usize>,
    /// Where each supernode's children begin among all children; ascending.
    starts: Vec<usize>,
    children: Vec<usize>,
    /// Ranges of supernodes, each with all that hand updates to it.
    branches: Vec<Range<usize>>,
    /// The supernodes that are in none, ascending.
    top: Vec<usize>,
}

impl Tree {
    /// `branches` are ranges of steps that are eliminated without the rest.
    pub fn of(symbolic: &SymbolicSupernodalCholesky<usize>, branches: &[Range<usize>]) -> Self {
        let count = symbolic.n_supernodes();
        let mut owner = vec![0; symbolic.nrows()];
        for s in 0..count {
            owner[symbolic.supernode_begin()[s]..symbolic.supernode_end()[s]].fill(s);
        }
        let parent = |s: usize| symbolic.supernode(s).pattern().first().map(|&step| owner[step]);
        let mut starts = vec![0; count + 1];
        (0..count).filter_map(parent).for_each(|parent| starts[parent + 1] += 1);
        (0..count).for_each(|s| starts[s + 1] += starts[s]);
        let (mut next, mut children) = (starts.clone(), vec![0; starts[count]]);
        for s in 0..count {
            if let Some(parent) = parent(s) {
                children[next[parent]] = s;
                next[parent] += 1;
            }
        }
        let mut tree = Self { owner, starts, children, branches: Vec::new(), top: Vec::new() };
        let whole = |steps: &Range<usize>| {
            let first = symbolic.supernode_begin().partition_point(|&begin| begin < steps.start);
            first..symbolic.supernode_end().partition_point(|&end| end <= steps.end)
        };
        let own = branches.iter().map(whole).filter(|range| !range.is_empty() && tree.is_closed(range));
        tree.branches = own.collect();
        let mut next = 0;
        for branch in &tree.branches {
            tree.top.extend(next..branch.start);
            next = branch.end;
        }
        tree.top.extend(next..count);
        tree
    }

    pub fn owner(&self) -> &[usize] {
        &self.owner
    }

    pub fn children(&self, s: usize) -> &[usize] {
        &self.children[self.starts[s]..self.starts[s + 1]]
    }

    pub fn branches(&self) -> &[Range<usize>] {
        &self.branches
    }

    pub fn top(&self) -> &[usize] {
        &self.top
    }

    fn is_closed(&self, range: &Range<usize>) -> bool {
        range.clone().all(|s| self.children(s).iter().all(|child| *child >= range.start))
    }
}

/// Where the entries of a matrix on the factor's pattern lie: per supernode a column-major panel of its pivot rows and
/// the rows below.
#[derive(Clone, Copy)]
pub(super) struct Shape<'a> {
    pub symbolic: &'a SymbolicSupernodalCholesky<usize>,
    pub tree: &'a Tree,
}

impl<'a> Shape<'a> {
    pub fn width(self, s: usize) -> usize {
        self.symbolic.supernode_end()[s] - self.symbolic.supernode_begin()[s]
    }

    /// Pivot rows and rows below.
    pub fn height(self, s: usize) -> usize {
        self.width(s) + self.below(s).len()
    }

    /// The steps of the rows below a supernode, ascending.
    pub fn below(self, s: usize) -> &'a [usize] {
        self.symbolic.supernode(s).pattern()
    }

    /// Where the panels of a range of supernodes lie among all values.
    pub fn span(self, supernodes: Range<usize>) -> Range<usize> {
        let starts = self.symbolic.col_ptr_for_val();
        starts[supernodes.start]..starts[supernodes.end]
    }

    /// About how many multiply-adds a supernode takes.
    pub fn work(self, s: usize) -> f64 {
        self.width(s) as f64 * (self.height(s) as f64).powi(2)
    }

    pub fn whole_work(self) -> f64 {
        (0..self.symbolic.n_supernodes()).map(|s| self.work(s)).sum()
    }

    /// A supernode's pivot block and the block below it.
    pub fn blocks(self, s: usize, panel: &[f64]) -> (MatRef<'_, f64>, MatRef<'_, f64>) {
        MatRef::from_column_major_slice(panel, self.height(s), self.width(s)).split_at_row(self.width(s))
    }

    /// A supernode's panel among all values.
    pub fn panel(self, s: usize, values: &[f64]) -> Panel<'_> {
        Panel::new(&values[self.span(s..s + 1)], self.height(s), self.width(s))
    }

    /// The matrix between the rows below a supernode, gathered from the panels of those that own them.
    pub fn trailing<'v>(self, s: usize, panel_of: impl Fn(usize) -> &'v [f64]) -> Mat<f64> {
        let below = self.below(s);
        let mut trailing = Mat::zeros(below.len(), below.len());
        let mut start = 0;
        while start < below.len() {
            let t = self.tree.owner[below[start]];
            let first = self.symbolic.supernode_begin()[t];
            let end = start + below[start..].partition_point(|&step| step < self.symbolic.supernode_end()[t]);
            let places = self.places(t, &below[start..]);
            let runs = runs(&places);
            let (panel, height) = (panel_of(t), self.height(t));
            for column in start..end {
                let values = &panel[(below[column] - first) * height..][..height];
                let to = trailing.col_as_slice_mut(column);
                for run in &runs[runs.partition_point(|run| run.end + start <= column)..] {
                    let from = run.start.max(column - start);
                    to[start + from..start + run.end].copy_from_slice(&values[places[from]..][..run.end - from]);
                }
            }
            start = end;
        }
        mirror(trailing.as_mut());
        trailing
    }

    /// Adds a child's update (its lower triangle) to supernode `s`: to its panel, and to `trailing` between the rows
    /// below.
    pub fn extend_add(self, s: usize, panel: &mut [f64], trailing: &mut Mat<f64>, child: usize, update: &Mat<f64>) {
        let places = self.places(s, self.below(child));
        let runs = runs(&places);
        let (width, height) = (self.width(s), self.height(s));
        for (column, &into) in places.iter().enumerate() {
            let own = update.col_as_slice(column);
            let (to, shift) = if into < width {
                (&mut panel[into * height..][..height], 0)
            } else {
                (trailing.col_as_slice_mut(into - width), width)
            };
            for run in &runs[runs.partition_point(|run| run.end <= column)..] {
                let own = &own[run.start.max(column)..run.end];
                let first = places[run.start.max(column)] - shift;
                to[first..first + own.len()].iter_mut().zip(own).for_each(|(to, value)| *to += value);
            }
        }
    }

    /// Where the entry between two steps, which must be on the pattern, lies among all values.
    pub fn address(self, a: usize, b: usize) -> usize {
        let (column, row) = (a.min(b), a.max(b));
        let s = self.tree.owner[column];
        let (first, end) = (self.symbolic.supernode_begin()[s], self.symbolic.supernode_end()[s]);
        let place =
            if row < end { row - first } else { end - first + self.below(s).partition_point(|&step| step < row) };
        self.symbolic.col_ptr_for_val()[s] + (column - first) * self.height(s) + place
    }

    /// Where each of the ascending `steps` lies among the rows of supernode `t`, which holds them all.
    fn places(self, t: usize, steps: &[usize]) -> Vec<usize> {
        let (first, end) = (self.symbolic.supernode_begin()[t], self.symbolic.supernode_end()[t]);
        let below = self.below(t);
        let mut at = 0;
        let place = |&step: &usize| {
            if step < end {
                return step - first;
            }
            while below[at] < step {
                at += 1;
            }
            end - first + at
        };
        steps.iter().map(place).collect()
    }
}

/// The ranges over which places follow one another.
fn runs(places: &[usize]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (k, &place) in places.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if places[k - 1] + 1 == place => run.end = k + 1,
            _ => runs.push(k..k + 1),
        }
    }
    runs
}
