//! The elimination tree of a supernodal factor: which supernode hands its update to which, and where entries lie.
//!
//! A supernode's columns share their rows, so they lie in one dense panel, column by column: its pivot rows, then the rows
//! below, whose matrix among themselves lies in the panels of supernodes eliminated later. [`Tree::trailing`] gathers that
//! matrix, [`Tree::extend_add`] hands a child's update to its parent (Duff and Reid 1983); both find rows by one walk over
//! two ascending lists.

use std::ops::Range;

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::{Mat, MatRef};

use super::dense::mirror;
use super::few::Panel;

/// Who eliminates what, and for whom; see the module.
pub(super) struct Tree {
    /// The first step of every supernode; at last, how many steps there are.
    begins: Vec<usize>,
    /// Where each one's rows below begin among all of theirs, which are steps, ascending.
    row_starts: Vec<usize>,
    rows: Vec<usize>,
    /// Where each one's panel begins among all values.
    panels: Vec<usize>,
    /// The supernode that eliminates each step.
    owner: Vec<usize>,
    /// Where each supernode's children begin among all children; ascending.
    starts: Vec<usize>,
    children: Vec<usize>,
}

impl Tree {
    pub fn of(symbolic: &SymbolicSupernodalCholesky<usize>) -> Self {
        let count = symbolic.n_supernodes();
        let mut begins = symbolic.supernode_begin().to_vec();
        begins.push(symbolic.nrows());
        let (mut row_starts, mut rows) = (vec![0], Vec::new());
        for s in 0..count {
            rows.extend_from_slice(symbolic.supernode(s).pattern());
            row_starts.push(rows.len());
        }
        Self::of_supernodes(begins, row_starts, rows)
    }

    /// Of supernodes by their first steps, with the number of steps at the end, and by the rows below them.
    pub fn of_supernodes(begins: Vec<usize>, row_starts: Vec<usize>, rows: Vec<usize>) -> Self {
        let count = begins.len() - 1;
        let mut owner = vec![0; begins[count]];
        (0..count).for_each(|s| owner[begins[s]..begins[s + 1]].fill(s));
        let mut panels = vec![0];
        for s in 0..count {
            let width = begins[s + 1] - begins[s];
            panels.push(panels[s] + width * (width + row_starts[s + 1] - row_starts[s]));
        }
        let parent = |s: usize| rows[row_starts[s]..row_starts[s + 1]].first().map(|&step| owner[step]);
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
        Self { begins, row_starts, rows, panels, owner, starts, children }
    }

    pub fn supernodes(&self) -> usize {
        self.begins.len() - 1
    }

    pub fn owner(&self) -> &[usize] {
        &self.owner
    }

    pub fn children(&self, s: usize) -> &[usize] {
        &self.children[self.starts[s]..self.starts[s + 1]]
    }

    /// Who takes a supernode's update: the owner of the first row below it.
    pub fn parent(&self, s: usize) -> Option<usize> {
        self.below(s).first().map(|&step| self.owner[step])
    }

    /// The supernodes of a range that hand their updates to one outside.
    pub fn handing_on(&self, range: &Range<usize>) -> impl Iterator<Item = usize> {
        range.clone().filter(move |&s| self.parent(s).is_some_and(|parent| !range.contains(&parent)))
    }

    /// The steps that supernodes eliminate.
    pub fn steps(&self, supernodes: Range<usize>) -> Range<usize> {
        self.begins[supernodes.start]..self.begins[supernodes.end]
    }

    /// The first step of a supernode.
    pub fn first(&self, s: usize) -> usize {
        self.begins[s]
    }

    pub fn width(&self, s: usize) -> usize {
        self.begins[s + 1] - self.begins[s]
    }

    /// Pivot rows and rows below.
    pub fn height(&self, s: usize) -> usize {
        self.width(s) + self.below(s).len()
    }

    /// The steps of the rows below a supernode, ascending.
    pub fn below(&self, s: usize) -> &[usize] {
        &self.rows[self.row_starts[s]..self.row_starts[s + 1]]
    }

    /// Where the panels of a range of supernodes lie among all values.
    pub fn span(&self, supernodes: Range<usize>) -> Range<usize> {
        self.panels[supernodes.start]..self.panels[supernodes.end]
    }

    /// About how many multiply-adds a supernode takes.
    pub fn work(&self, s: usize) -> f64 {
        self.width(s) as f64 * (self.height(s) as f64).powi(2)
    }

    pub fn whole_work(&self) -> f64 {
        self.work_of(0..self.supernodes())
    }

    pub fn work_of(&self, supernodes: Range<usize>) -> f64 {
        supernodes.map(|s| self.work(s)).sum()
    }

    /// A supernode's pivot block and the block below it, of its panel.
    pub fn blocks<'v>(&self, s: usize, panel: &'v [f64]) -> (MatRef<'v, f64>, MatRef<'v, f64>) {
        MatRef::from_column_major_slice(panel, self.height(s), self.width(s)).split_at_row(self.width(s))
    }

    /// A supernode's panel among all values.
    pub fn panel<'v>(&self, s: usize, values: &'v [f64]) -> Panel<'v> {
        Panel::new(&values[self.span(s..s + 1)], self.height(s), self.width(s))
    }

    /// The matrix between the rows below a supernode, gathered from the panels of those that own them.
    pub fn trailing<'v>(&self, s: usize, panel_of: impl Fn(usize) -> &'v [f64]) -> Mat<f64> {
        let below = self.below(s);
        let mut trailing = Mat::zeros(below.len(), below.len());
        let mut start = 0;
        while start < below.len() {
            let t = self.owner[below[start]];
            let first = self.begins[t];
            let end = start + below[start..].partition_point(|&step| step < self.begins[t + 1]);
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
    pub fn extend_add(&self, s: usize, panel: &mut [f64], trailing: &mut Mat<f64>, child: usize, update: &Mat<f64>) {
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
    pub fn address(&self, a: usize, b: usize) -> usize {
        let (column, row) = (a.min(b), a.max(b));
        let s = self.owner[column];
        let (first, end) = (self.begins[s], self.begins[s + 1]);
        let place =
            if row < end { row - first } else { end - first + self.below(s).partition_point(|&step| step < row) };
        self.panels[s] + (column - first) * self.height(s) + place
    }

    /// Where each of the ascending `steps` lies among the rows of supernode `t`, which holds them all.
    fn places(&self, t: usize, steps: &[usize]) -> Vec<usize> {
        let (first, end) = (self.begins[t], self.begins[t + 1]);
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

    /// Whether the parent of a supernode has all rows below it that are not the parent's own, as a factor's have.
    pub fn hands_on_all(&self, s: usize) -> bool {
        let Some(parent) = self.parent(s) else { return true };
        let (own, above) = (self.below(s), self.below(parent));
        own.iter().all(|step| self.owner[*step] == parent || above.binary_search(step).is_ok())
    }

    /// The supernodes that eliminate these steps and no others.
    pub fn within(&self, steps: &Range<usize>) -> Range<usize> {
        let count = self.supernodes();
        let first = self.begins[..count].partition_point(|&begin| begin < steps.start);
        first..self.begins[1..].partition_point(|&end| end <= steps.end)
    }

    /// Whether a range of supernodes has all that hand updates to it.
    pub fn is_closed(&self, range: &Range<usize>) -> bool {
        range.clone().all(|s| self.children(s).iter().all(|child| *child >= range.start))
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
