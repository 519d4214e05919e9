//! Sparse matrices by columns, as files and clients want them.

/// A sparse matrix by columns: `indices[starts[k]..starts[k + 1]]` are the rows of column `k`, ascending.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CompressedColumns {
    pub rows: usize,
    pub starts: Vec<usize>,
    pub indices: Vec<usize>,
    pub values: Vec<f64>,
}

impl CompressedColumns {
    pub fn new(rows: usize) -> Self {
        Self { rows, starts: vec![0], indices: Vec::new(), values: Vec::new() }
    }

    /// From columns of (row, value) in any order.
    pub fn of(rows: usize, columns: impl IntoIterator<Item = Vec<(usize, f64)>>) -> Self {
        let mut own = Self::new(rows);
        for mut column in columns {
            column.sort_unstable_by_key(|(row, _)| *row);
            own.push(column);
        }
        own
    }

    pub fn columns(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Appends a column; the entries' rows must ascend.
    pub fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>) {
        for (row, value) in entries {
            self.indices.push(row);
            self.values.push(value);
        }
        self.starts.push(self.indices.len());
    }

    /// A column's entries.
    pub fn column(&self, k: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let span = self.starts[k]..self.starts[k + 1];
        self.indices[span.clone()].iter().copied().zip(self.values[span].iter().copied())
    }
}
