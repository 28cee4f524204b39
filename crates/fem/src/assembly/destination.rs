//! Where the results of the elements are summed: one loop for all kinds of results.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::{FemWorkspace, ROWS, ScatterLists};
use crate::{element::NodalShares, material::BatchReport, model::Batch};

/// Lists that take results `R` to the upper blocks and the nodal forces, in the same order of additions whether batch by
/// batch or row by row.
pub(super) trait Destination<R>: Sync {
    /// Results of a batch.
    fn results_of(&self, batch: &Batch) -> usize;

    /// Adds the results of a batch; an empty `upper` gets nothing.
    fn scatter(&self, batch: &Batch, results: &[R], upper: &mut [Matrix3<f64>], f_int: &mut [Vector3<f64>]);

    /// Completes the blocks after the last batch.
    fn finish(&self, _upper: &mut [Matrix3<f64>]) {}

    /// Upper block `p` from the results of all batches.
    fn gather_block(&self, p: usize, results: &[R]) -> Matrix3<f64>;

    /// Internal force of mesh node `i` from the results of all batches.
    fn gather_force(&self, i: usize, results: &[R]) -> Vector3<f64>;
}

/// The lists for results of single elements.
pub(super) struct Elements<'a> {
    pub(super) lists: &'a ScatterLists,
    /// Slot of each element among the results; empty on one thread.
    pub(super) slot: &'a [u32],
}

impl<R: NodalShares + Sync> Destination<R> for Elements<'_> {
    fn results_of(&self, batch: &Batch) -> usize {
        batch.elements.len()
    }

    fn scatter(&self, batch: &Batch, results: &[R], upper: &mut [Matrix3<f64>], f_int: &mut [Vector3<f64>]) {
        self.lists.scatter(batch.elements.start, results, upper, f_int);
    }

    fn gather_block(&self, p: usize, results: &[R]) -> Matrix3<f64> {
        self.lists.gather_block(p, results, self.slot)
    }

    fn gather_force(&self, i: usize, results: &[R]) -> Vector3<f64> {
        self.lists.gather_force(i, results, self.slot)
    }
}

/// What is summed: the batches, the blocks (none where only forces are asked for) and the nodal forces.
pub(super) struct Sums<'a> {
    pub(super) batches: &'a [Batch],
    pub(super) parallel: bool,
    pub(super) upper: &'a mut [Matrix3<f64>],
    pub(super) f_int: &'a mut [Vector3<f64>],
}

impl Sums<'_> {
    /// Sums what `compute` puts into the results of each batch; `size` is the room of a batch among all results.
    pub(super) fn fill<R: Send + Sync>(
        self,
        to: &impl Destination<R>,
        size: usize,
        results: &mut [R],
        compute: impl Fn(&Batch, &mut [R]) -> BatchReport + Sync,
    ) -> BatchReport {
        let compute = |batch: &Batch, results: &mut [R]| {
            compute(batch, &mut results[..to.results_of(batch)]).shifted(batch.elements.start as u32)
        };
        let Self { batches, parallel, upper, f_int } = self;
        if !parallel {
            upper.fill(Matrix3::zeros());
            f_int.fill(Vector3::zeros());
            let mut report = BatchReport::default();
            for batch in batches {
                report = report.merged(compute(batch, results));
                to.scatter(batch, &results[..to.results_of(batch)], upper, f_int);
            }
            to.finish(upper);
            return report;
        }
        let report = (results.par_chunks_mut(size).zip(batches))
            .map(|(results, batch)| compute(batch, results))
            .reduce(BatchReport::default, BatchReport::merged);
        let results = &*results;
        upper.par_chunks_mut(8 * ROWS).enumerate().for_each(|(chunk, upper)| {
            for (k, block) in upper.iter_mut().enumerate() {
                *block = to.gather_block(8 * ROWS * chunk + k, results);
            }
        });
        f_int.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, f_int)| {
            for (k, f) in f_int.iter_mut().enumerate() {
                *f = to.gather_force(ROWS * chunk + k, results);
            }
        });
        report
    }
}

/// Whether this workspace assembles on several threads here.
pub(super) fn is_parallel(ws: &FemWorkspace) -> bool {
    !ws.slot.is_empty() && rayon::current_num_threads() > 1
}
