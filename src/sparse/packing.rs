//! How a branch becomes a [`Parcel`].

use std::ops::Range;

use super::parcel::{Parcel, triangle};
use super::tree::Tree;

/// What is particular to a pass.
pub(super) enum Matter<'p, 'v> {
    /// The branch's values.
    Up(&'p [f64]),
    /// The panels of those that own rows outside, by supernode and matrix.
    Down { above: &'p (dyn Fn(usize, usize) -> &'v [f64] + Sync), matrices: usize, wanted: &'p [u32] },
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
    for s in tree.handing_on(branch) {
        let between = tree.trailing(s, above);
        let at: Vec<usize> = tree.below(s).iter().map(|step| border.partition_point(|other| other < step)).collect();
        for (column, &to) in at.iter().enumerate() {
            let first = triangle(count) - triangle(count - to);
            (column..at.len()).for_each(|row| block[first + at[row] - to] = between[(row, column)]);
        }
    }
    block
}
