//! A dense, unsymmetric linear system in kept memory: LU with partial pivoting (faer), on one thread.

use crate::augmented::Augmented;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{PartialPivLuParams, lu_in_place, lu_in_place_scratch};
use faer::mat::MatMut;
use faer::{Auto, Par, Spec};

/// A system and scratch.
pub(crate) struct LinearSystem {
    pub(crate) augmented: Augmented,
    order: Vec<usize>,
    inverse: Vec<usize>,
    memory: MemBuffer,
}

impl LinearSystem {
    /// Memory for systems of up to `capacity` unknowns.
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        let scratch = lu_in_place_scratch::<usize, f64>(capacity, capacity + 1, Par::Seq, params());
        Self {
            augmented: Augmented::with_capacity(capacity),
            order: vec![0; capacity],
            inverse: vec![0; capacity],
            memory: MemBuffer::new(scratch),
        }
    }

    /// Solves, destroying the system; `None` where a number is not finite or a pivot is zero.
    pub(crate) fn solve(&mut self) -> Option<&[f64]> {
        let n = self.augmented.rows();
        let numbers = self.augmented.numbers_mut();
        if numbers.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let matrix = MatMut::from_column_major_slice_mut(numbers, n, n + 1);
        // The right side is a column of its own: eliminated along with the others it becomes L^-1 P b.
        lu_in_place(
            matrix,
            &mut self.order[..n],
            &mut self.inverse[..n],
            Par::Seq,
            MemStack::new(&mut self.memory),
            params(),
        );
        self.augmented.substitute()
    }
}

/// Lets faer's matrix products reserve the packing memory that they keep for the calling thread.
pub(crate) fn warm_thread() {
    const SIZE: usize = 192;
    let mut system = LinearSystem::with_capacity(SIZE);
    system.augmented.reset(SIZE);
    for j in 0..=SIZE {
        for (i, entry) in system.augmented.column_mut(j).iter_mut().enumerate() {
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
        Self::with_capacity(self.augmented.capacity())
    }
}

impl std::fmt::Debug for LinearSystem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LinearSystem").field("rows", &self.augmented.rows()).finish_non_exhaustive()
    }
}
