//! Rows with few nonzeros over the free nodes of a body: constraint Jacobians `H` and other right-hand sides.

use nalgebra::Vector3;

/// A matrix `H` of `m` rows over `3 n` degrees of freedom, stored by row as (free node, 3-vector) pairs.
///
/// `H[r, 3 k .. 3 k + 3] = value` for every entry `(k, value)` of row `r`. A node occurs at most once in a row.
#[derive(Clone, Debug, Default)]
pub struct NodalRows {
    /// Start of each row in `node` and `value`; `m + 1` entries (empty before the first row is pushed).
    row_start: Vec<usize>,
    node: Vec<u32>,
    value: Vec<Vector3<f64>>,
}

impl NodalRows {
    /// An empty matrix with memory for `rows` rows of `entries_per_row` nodes.
    pub fn with_capacity(rows: usize, entries_per_row: usize) -> Self {
        let mut row_start = Vec::with_capacity(rows + 1);
        row_start.push(0);
        Self {
            row_start,
            node: Vec::with_capacity(rows * entries_per_row),
            value: Vec::with_capacity(rows * entries_per_row),
        }
    }

    /// Removes all rows and keeps the memory.
    pub fn clear(&mut self) {
        self.row_start.clear();
        self.row_start.push(0);
        self.node.clear();
        self.value.clear();
    }

    /// Appends a row of (free node, 3-vector) entries.
    pub fn push_row(&mut self, entries: impl IntoIterator<Item = (u32, Vector3<f64>)>) {
        if self.row_start.is_empty() {
            self.row_start.push(0);
        }
        for (node, value) in entries {
            self.node.push(node);
            self.value.push(value);
        }
        self.row_start.push(self.node.len());
    }

    /// Number of rows `m`.
    pub fn len(&self) -> usize {
        self.row_start.len().saturating_sub(1)
    }

    /// True where there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Entries of row `r`.
    pub fn row(&self, r: usize) -> impl Iterator<Item = (u32, Vector3<f64>)> + '_ {
        let range = self.row_start[r]..self.row_start[r + 1];
        self.node[range.clone()].iter().copied().zip(self.value[range].iter().copied())
    }

    /// Replaces every value by `f(free node, value)`: used to rotate rows into the frame of an older factor.
    pub fn map_values(&mut self, mut f: impl FnMut(u32, Vector3<f64>) -> Vector3<f64>) {
        for (node, value) in self.node.iter().zip(self.value.iter_mut()) {
            *value = f(*node, *value);
        }
    }

    /// Row `r` times a vector over the degrees of freedom (length `3 n`).
    pub fn dot(&self, r: usize, x: &[f64]) -> f64 {
        self.row(r)
            .map(|(k, v)| {
                let i = 3 * k as usize;
                v.x * x[i] + v.y * x[i + 1] + v.z * x[i + 2]
            })
            .sum()
    }

    /// `x += Hᵀ λ`.
    pub fn add_transposed(&self, lambda: &[f64], x: &mut [f64]) {
        for r in 0..self.len() {
            for (k, v) in self.row(r) {
                let i = 3 * k as usize;
                x[i] += v.x * lambda[r];
                x[i + 1] += v.y * lambda[r];
                x[i + 2] += v.z * lambda[r];
            }
        }
    }
}
