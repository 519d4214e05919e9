//! A branch of the elimination tree by itself: all that its part of a pass takes, and what comes back.
//!
//! Whoever gets a parcel needs nothing else: neither the map's scans nor the rest of its system. On the way up a branch
//! is its entries; its answer are the panels that they become, and what it hands on, its Schur complement on the border,
//! the rows outside that its own touch. On the way down it is given the border's block of the matrices that are sought,
//! and its answer are the entries that are wanted of them.
//!
//! Steps are numbered from the branch's first; those of the border follow, in the order of their elimination. Of symmetric
//! matrices the lower triangle is sent, column after column.

use std::ops::Range;

use super::tree::Tree;

/// A branch's part of a pass.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parcel {
    /// The first step of every supernode; at last, how many steps are the branch's own.
    pub begins: Vec<u32>,
    /// Where each one's rows below begin among all of theirs; at last, how many there are.
    pub row_starts: Vec<u32>,
    pub rows: Vec<u32>,
    /// How many rows the border has.
    pub border: u32,
    /// How many matrices are sought on the way down; none on the way up.
    pub matrices: u32,
    /// On the way up: where entries lie that are not zero, among the branch's values, and what they are.
    pub places: Vec<u32>,
    pub entries: Vec<f64>,
    /// On the way down: the border's block of every matrix, and the places that are wanted.
    pub above: Vec<f64>,
    pub wanted: Vec<u32>,
    /// Panels of the factor, and of the elimination's derivative; none where the pass does without.
    pub factor: Vec<f64>,
    pub derivative: Vec<f64>,
}

/// What became of a branch.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Answer {
    /// On the way up its panels; on the way down what was wanted, of all matrices place by place.
    pub values: Vec<f64>,
    /// The updates of those supernodes that hand one to another outside the branch, in their order.
    pub handed_on: Vec<f64>,
}

/// What is particular to a pass.
pub(super) enum Matter<'p, 'v> {
    /// The branch's values.
    Up(&'p [f64]),
    /// The panels of those that own rows outside, by supernode and matrix.
    Down { above: &'p dyn Fn(usize, usize) -> &'v [f64], matrices: usize, wanted: &'p [u32] },
}

/// Entries of a lower triangle.
pub(super) fn triangle(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

impl Parcel {
    pub(super) fn of(tree: &Tree, branch: Range<usize>, matter: Matter<'_, '_>, sources: [&[f64]; 2]) -> Self {
        let steps = tree.steps(branch.clone());
        let border = border(tree, &branch);
        // Addresses of a factor are of 32 bits, and there are fewer steps than entries.
        let own = |step: usize| match steps.contains(&step) {
            true => (step - steps.start) as u32,
            false => (steps.len() + border.partition_point(|&other| other < step)) as u32,
        };
        let begins = branch.clone().map(|s| (tree.first(s) - steps.start) as u32).chain([steps.len() as u32]);
        let (mut row_starts, mut rows) = (vec![0], Vec::new());
        for s in branch.clone() {
            rows.extend(tree.below(s).iter().map(|&step| own(step)));
            row_starts.push(rows.len() as u32);
        }
        let [factor, derivative] = sources.map(<[f64]>::to_vec);
        let mut parcel = Self {
            begins: begins.collect(),
            row_starts,
            rows,
            border: border.len() as u32,
            factor,
            derivative,
            ..Self::default()
        };
        match matter {
            Matter::Up(values) => {
                let some = values.iter().enumerate().filter(|(_, value)| value.to_bits() != 0);
                (parcel.places, parcel.entries) = some.map(|(at, value)| (at as u32, *value)).unzip();
            }
            Matter::Down { above, matrices, wanted } => {
                parcel.matrices = matrices as u32;
                parcel.wanted = wanted.to_vec();
                for k in 0..matrices {
                    let block = block_of(tree, &branch, &border, &|t| above(t, k));
                    parcel.above.extend(block);
                }
            }
        }
        parcel
    }

    /// About how many bytes it takes to work on it, its own among them.
    pub fn working_bytes(&self) -> usize {
        let steps = self.begins.windows(2).map(|own| (own[1].saturating_sub(own[0])) as usize);
        let below = self.row_starts.windows(2).map(|own| (own[1].saturating_sub(own[0])) as usize);
        let (mut panels, mut widest) = (0, 0);
        for (width, rows) in steps.zip(below) {
            panels += width * (width + rows);
            widest = widest.max((width + rows) * (width + rows));
        }
        let held = self.factor.len() + self.derivative.len() + 3 * self.above.len() + 2 * self.entries.len();
        8 * (held + (self.matrices.max(1) as usize + 1) * (panels + 3 * widest))
    }
}

/// The steps outside a branch that its rows touch, ascending.
fn border(tree: &Tree, branch: &Range<usize>) -> Vec<usize> {
    let end = tree.steps(branch.clone()).end;
    let rows = branch.clone().flat_map(|s| tree.below(s));
    let mut border: Vec<usize> = rows.copied().filter(|&step| step >= end).collect();
    border.sort_unstable();
    border.dedup();
    border
}

/// A matrix between the rows of a border, as far as a supernode's rows lie in it together; zero elsewhere, which nobody
/// reads.
fn block_of<'v>(tree: &Tree, branch: &Range<usize>, border: &[usize], above: &dyn Fn(usize) -> &'v [f64]) -> Vec<f64> {
    let count = border.len();
    let mut block = vec![0.0; triangle(count)];
    let outside = branch.clone().filter(|&s| tree.parent(s).is_some_and(|parent| !branch.contains(&parent)));
    for s in outside {
        let between = tree.trailing(s, above);
        let at: Vec<usize> = tree.below(s).iter().map(|step| border.partition_point(|other| other < step)).collect();
        for (column, &to) in at.iter().enumerate() {
            let first = triangle(count) - triangle(count - to);
            (column..at.len()).for_each(|row| block[first + at[row] - to] = between[(row, column)]);
        }
    }
    block
}
