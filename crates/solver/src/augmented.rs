//! Numbers of a dense linear system in kept memory: the matrix by columns, with the right side behind it.

/// Memory of systems of up to a number of unknowns.
#[derive(Clone, Debug)]
pub(crate) struct Augmented {
    numbers: Vec<f64>,
    rows: usize,
    capacity: usize,
}

impl Augmented {
    /// Memory for systems of up to `capacity` unknowns.
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        Self { numbers: Vec::with_capacity(capacity * (capacity + 1)), rows: 0, capacity }
    }

    /// Unknowns there is room for.
    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Unknowns of the system.
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// Sizes the system to `rows` unknowns, all numbers zero. Past the capacity it becomes empty.
    pub(crate) fn reset(&mut self, rows: usize) {
        self.rows = if rows <= self.capacity { rows } else { 0 };
        self.numbers.clear();
        self.numbers.resize(self.rows * (self.rows + 1), 0.0);
    }

    /// Column `j` of the matrix; the right side for `j` the number of unknowns.
    pub(crate) fn column_mut(&mut self, j: usize) -> &mut [f64] {
        let rows = self.rows;
        self.numbers.get_mut(j * rows..(j + 1) * rows).unwrap_or(&mut [])
    }

    /// All numbers, column by column.
    pub(crate) fn numbers_mut(&mut self) -> &mut [f64] {
        &mut self.numbers
    }

    /// Solves with the matrix made upper triangular, what is below the diagonal unread; `None` where a number is not finite or
    /// a pivot is zero.
    pub(crate) fn substitute(&mut self) -> Option<&[f64]> {
        let n = self.rows;
        let (factor, x) = self.numbers.split_at_mut(n * n);
        for j in (0..n).rev() {
            let column = &factor[j * n..(j + 1) * n];
            let value = x[j] / column[j];
            if !value.is_finite() {
                return None;
            }
            x[j] = value;
            for (entry, u) in x[..j].iter_mut().zip(column) {
                *entry -= u * value;
            }
        }
        Some(x)
    }
}
