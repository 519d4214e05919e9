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

/// Entries of a lower triangle.
pub(super) fn triangle(rows: usize) -> usize {
    rows * (rows + 1) / 2
}
