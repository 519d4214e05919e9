//! A branch of the elimination tree by itself: all that its part of a pass takes, and what comes back.
//!
//! Whoever gets a parcel needs nothing else: neither the map's scans nor the rest of its system. On the way up a branch
//! is its entries; its answer are the panels that they become, and what it hands on, its Schur complement on the border,
//! the rows outside that its own touch. On the way down it is given the border's block of the matrices that are sought,
//! and its answer are the entries that are wanted of them.
//!
//! Steps are numbered from the branch's first; those of the border follow, in the order of their elimination. Of symmetric
//! matrices the lower triangle is sent, column after column.

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

impl Parcel {
    /// Every supernode's width, and how many rows are below it. Of a parcel that is none, something.
    fn fronts(&self) -> impl Iterator<Item = (usize, usize)> {
        let lengths = |starts: &[u32]| starts.windows(2).map(|own| own[1].saturating_sub(own[0]) as usize).collect();
        let (widths, rows): (Vec<usize>, Vec<usize>) = (lengths(&self.begins), lengths(&self.row_starts));
        widths.into_iter().zip(rows)
    }

    /// Entries of the branch's panels, or as many as there are numbers for.
    pub(super) fn panels(&self) -> usize {
        self.fronts().fold(0, |sum: usize, (width, rows)| sum.saturating_add(width.saturating_mul(width + rows)))
    }

    /// About how many bytes it takes to work on it, its own among them.
    pub fn working_bytes(&self) -> usize {
        let widest = self.fronts().map(|(width, rows)| (width + rows).saturating_pow(2)).max().unwrap_or(0);
        let held = self.factor.len() + self.derivative.len() + 3 * self.above.len() + 2 * self.entries.len();
        let matrices = self.matrices.max(1) as usize + 1;
        let working = matrices.saturating_mul(self.panels().saturating_add(widest.saturating_mul(3)));
        working.saturating_add(held).saturating_mul(8)
    }
}

/// Entries of a lower triangle.
pub(super) fn triangle(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

/// The columns of a packed lower triangle, each from the diagonal on.
pub(super) fn columns(packed: &[f64], rows: usize) -> impl Iterator<Item = &[f64]> {
    let mut rest = packed;
    (0..rows).map(move |column| {
        let (own, others) = rest.split_at(rows - column);
        rest = others;
        own
    })
}
