//! The elements' forces and blocks, computed batch by batch and summed over the body.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::{
    AssemblyReport, FemWorkspace, ROWS,
    packed::{CHUNK, PackLists},
    viscous::StepTissue,
};
use crate::{
    element::{ElementKind, quadratic::POINTS},
    material::BatchReport,
    model::{Batch, FemModel, FemState},
    pack::{DeformedPack, PackMatrices, PackShares},
};

/// What is asked of the elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wanted {
    /// Forces alone.
    Forces,
    /// Forces and tangents, these filtered or not.
    Tangents { filter: bool },
}

/// Computes all elements over a step `dt` (s) in which viscous tissue relaxes, and sums them into `ws.f_int` and, with
/// tangents, `ws.upper`.
pub(super) fn sum_elements(
    model: &FemModel,
    state: &FemState,
    dt: f64,
    wanted: Wanted,
    ws: &mut FemWorkspace,
) -> AssemblyReport {
    let q = &state.q;
    // A workspace made on one thread assembles on one everywhere.
    let parallel = ws.parallel && rayon::current_num_threads() > 1;
    let tangents = wanted != Wanted::Forces;
    // Linear elasticity has its volume changes within each element.
    let groups = model.averaging().filter(|_| !ws.led);
    if let Some(groups) = groups {
        groups.pressures(model.packs(), q, wanted == Wanted::Tangents { filter: true }, parallel, &mut ws.averaging);
    }
    let (led, averages) = (ws.led, &ws.averaging);
    let upper = if tangents { ws.upper.as_mut_slice() } else { &mut [] };
    let sums = Sums { lists: model.pack_lists(), batches: model.batches(), parallel, upper, f_int: &mut ws.f_int };
    let size = model.packs_of_batch();
    let report = if model.element_kind() == ElementKind::Quadratic {
        let points = || [PackMatrices::ZERO; POINTS];
        sums.fill(size, &mut ws.quadratic_results, points, |batch, points, results| {
            let tissue = if led { StepTissue::led(batch) } else { StepTissue::new(batch, state, dt) };
            let (mut report, mut first) = (BatchReport::default(), 0);
            for (pack, out) in model.quadratic_packs()[batch.packs.clone()].iter().zip(results) {
                for (k, (at, point)) in pack.at_points(q).iter().zip(&mut *points).enumerate() {
                    tissue.pack(at, |lane| POINTS * (first + lane) + k, wanted, point);
                }
                if tangents {
                    pack.sum_points(points, out);
                } else {
                    pack.sum_forces(points, out);
                }
                out.note(first as u32, pack.len, &mut report);
                first += pack.len;
            }
            report
        })
    } else {
        sums.fill(
            size,
            &mut ws.pack_results,
            || (),
            |batch, (), results| {
                let tissue = if led { StepTissue::led(batch) } else { StepTissue::new(batch, state, dt) };
                let (mut report, mut first) = (BatchReport::default(), 0);
                for (p, out) in batch.packs.clone().zip(results) {
                    let pack = &model.packs()[p];
                    let pressure = groups.and_then(|_| averages.pressures.get(p));
                    let at = DeformedPack { pressure, ..pack.at(q) };
                    tissue.pack(&at, |lane| first + lane, wanted, out);
                    if let Some(groups) = groups {
                        groups.mark_dropped(p, averages, &mut out.filtered);
                    }
                    out.note(first as u32, pack.len, &mut report);
                    first += pack.len;
                }
                report
            },
        )
    };
    if let (true, Some(groups)) = (tangents, groups) {
        groups.add_blocks(parallel, &mut ws.averaging, &mut ws.upper);
    }
    let upper = if tangents { ws.upper.as_mut_slice() } else { &mut [] };
    ws.folds.add(model, q, wanted == Wanted::Tangents { filter: true }, upper, &mut ws.f_int);
    AssemblyReport::new(report, model)
}

/// What is summed: the batches, the blocks (none where only forces are asked for) and the nodal forces.
struct Sums<'a> {
    lists: &'a PackLists,
    batches: &'a [Batch],
    parallel: bool,
    upper: &'a mut [Matrix3<f64>],
    f_int: &'a mut [Vector3<f64>],
}

impl Sums<'_> {
    /// Sums what `compute` puts into the results of each batch; `size` is the room of a batch among all results, in packs.
    fn fill<const N: usize, const B: usize, W>(
        self,
        size: usize,
        results: &mut [PackShares<N, B>],
        scratch: impl Fn() -> W + Send + Sync,
        compute: impl Fn(&Batch, &mut W, &mut [PackShares<N, B>]) -> BatchReport + Sync,
    ) -> BatchReport {
        let compute = |batch: &Batch, scratch: &mut W, results: &mut [PackShares<N, B>]| {
            let results = &mut results[..batch.packs.len()];
            compute(batch, scratch, results).shifted(batch.elements.start as u32)
        };
        let Self { lists, batches, parallel, upper, f_int } = self;
        if !parallel {
            upper.fill(Matrix3::zeros());
            f_int.fill(Vector3::zeros());
            let (mut report, mut scratch) = (BatchReport::default(), scratch());
            for batch in batches {
                report = report.merged(compute(batch, &mut scratch, results));
                lists.scatter(batch.packs.clone(), results, upper, f_int);
            }
            lists.finish(upper);
            return report;
        }
        let report = (results.par_chunks_mut(size).zip(batches))
            .map_init(scratch, |scratch, (results, batch)| compute(batch, scratch, results))
            .reduce(BatchReport::default, BatchReport::merged);
        let results = &*results;
        upper.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, upper)| {
            lists.gather_blocks(chunk, results, upper);
        });
        f_int.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, f_int)| {
            for (k, f) in f_int.iter_mut().enumerate() {
                *f = lists.gather_force(ROWS * chunk + k, results);
            }
        });
        report
    }
}
