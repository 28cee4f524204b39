//! What a linear solver must offer to be filled: its matrix by columns, in its own precision.

use crate::dense::LinearSystem;
use crate::krylov::KrylovSystem;

/// A matrix by columns, in the precision of its solver, with the right side behind it.
pub(crate) trait Columns {
    /// A number of the matrix.
    type Entry: Copy;

    /// Column `j`; the right side for `j` the number of unknowns.
    fn column_mut(&mut self, j: usize) -> &mut [Self::Entry];

    /// A number in that precision.
    fn entry(value: f64) -> Self::Entry;

    /// Adds to an entry.
    fn add(entry: &mut Self::Entry, value: f64);
}

impl Columns for LinearSystem {
    type Entry = f64;

    fn column_mut(&mut self, j: usize) -> &mut [f64] {
        LinearSystem::column_mut(self, j)
    }

    fn entry(value: f64) -> f64 {
        value
    }

    fn add(entry: &mut f64, value: f64) {
        *entry += value;
    }
}

impl Columns for KrylovSystem {
    type Entry = f32;

    fn column_mut(&mut self, j: usize) -> &mut [f32] {
        KrylovSystem::column_mut(self, j)
    }

    fn entry(value: f64) -> f32 {
        value as f32
    }

    fn add(entry: &mut f32, value: f64) {
        *entry += value as f32;
    }
}
