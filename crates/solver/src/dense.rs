//! A dense, unsymmetric linear system in kept memory: LU with partial pivoting (faer), on one thread.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{PartialPivLuParams, lu_in_place, lu_in_place_scratch};
use faer::mat::MatMut;
use faer::{Auto, Par, Spec};

/// Memory of systems of up to a number of unknowns: the matrix by columns with the right side behind it, and scratch.
pub(crate) struct LinearSystem {
    numbers: Vec<f64>,
    rows: usize,
    order: Vec<usize>,
    inverse: Vec<usize>,
    memory: MemBuffer,
    capacity: usize,
}

impl LinearSystem {
    /// Memory for systems of up to `capacity` unknowns.
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        let scratch = lu_in_place_scratch::<usize, f64>(capacity, capacity + 1, Par::Seq, params());
        Self {
            numbers: Vec::with_capacity(capacity * (capacity + 1)),
            rows: 0,
            order: vec![0; capacity],
            inverse: vec![0; capacity],
            memory: MemBuffer::new(scratch),
            capacity,
        }
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

    /// Solves, destroying the system; `None` where a number is not finite or a pivot is zero.
    pub(crate) fn solve(&mut self) -> Option<&[f64]> {
        let n = self.rows;
        if self.numbers.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let matrix = MatMut::from_column_major_slice_mut(&mut self.numbers, n, n + 1);
        // The right side is a column of its own: eliminated along with the others it becomes L^-1 P b.
        lu_in_place(
            matrix,
            &mut self.order[..n],
            &mut self.inverse[..n],
            Par::Seq,
            MemStack::new(&mut self.memory),
            params(),
        );
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

/// Lets faer's matrix products reserve the packing memory that they keep for the calling thread.
pub(crate) fn warm_thread() {
    const SIZE: usize = 192;
    let mut system = LinearSystem::with_capacity(SIZE);
    system.reset(SIZE);
    for j in 0..=SIZE {
        for (i, entry) in system.column_mut(j).iter_mut().enumerate() {
            *entry = if i == j { 2.0 } else { 1.0 / (1 + i + j) as f64 };
        }
    }
    let _ = system.solve();
}

fn params() -> Spec<PartialPivLuParams, f64> {
    Spec::new(<PartialPivLuParams as Auto<f64>>::auto())
}

impl Clone for LinearSystem {
    /// Memory of the same size; the numbers of a system do not outlive its solution.
    fn clone(&self) -> Self {
        Self::with_capacity(self.capacity)
    }
}

impl std::fmt::Debug for LinearSystem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LinearSystem").field("rows", &self.rows).field("capacity", &self.capacity).finish()
    }
}
