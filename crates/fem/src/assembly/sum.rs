//! The elements' forces and blocks, computed batch by batch and summed over the body.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::{
    AssemblyReport, FemWorkspace,
    packed::{PackLists, Part},
    viscous::StepTissue,
};
use crate::{
    element::{ElementKind, quadratic::POINTS},
    material::BatchReport,
    model::{Batch, FemModel, FemState},
    pack::{DeformedPack, PackMatrices, PackShares},
};

/// Upper blocks, or nodes, that one task gathers.
const CHUNK: usize = 512;

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
    let parallel = rayon::current_num_threads() > 1;
    let tangents = wanted != Wanted::Forces;
    // Linear elasticity has its volume changes within each element.
    let groups = model.averaging().filter(|_| !ws.led);
    if let Some(groups) = groups {
        groups.pressures(model.packs(), q, wanted == Wanted::Tangents { filter: true }, parallel, &mut ws.averaging);
    }
    let (led, averages) = (ws.led, &ws.averaging);
    let upper = if tangents { ws.upper.as_mut_slice() } else { &mut [] };
    let sums = Sums {
        lists: model.pack_lists(),
        batches: model.batches(),
        parallel,
        upper,
        f_int: &mut ws.f_int,
        part_blocks: &mut ws.part_blocks,
        part_forces: &mut ws.part_forces,
    };
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

/// What is summed: the batches, the blocks (none where only forces are asked for) and the nodal forces; and the places of
/// the parts, where there are several.
struct Sums<'a> {
    lists: &'a PackLists,
    batches: &'a [Batch],
    parallel: bool,
    upper: &'a mut [Matrix3<f64>],
    f_int: &'a mut [Vector3<f64>],
    part_blocks: &'a mut [Matrix3<f64>],
    part_forces: &'a mut [Vector3<f64>],
}

impl Sums<'_> {
    /// Sums what `compute` puts into the results of each batch; `size` is the room of a batch among the results, in packs, of
    /// which there is one for each part.
    fn fill<const N: usize, const B: usize, W>(
        self,
        size: usize,
        results: &mut [PackShares<N, B>],
        scratch: impl Fn() -> W + Sync,
        compute: impl Fn(&Batch, &mut W, &mut [PackShares<N, B>]) -> BatchReport + Sync,
    ) -> BatchReport {
        let Self { lists, batches, parallel, upper, f_int, part_blocks, part_forces } = self;
        // The packs of a part one after the other, into its places.
        let part = |part: &Part, results: &mut [_], blocks: &mut [Matrix3<f64>], forces: &mut [Vector3<f64>]| {
            blocks.fill(Matrix3::zeros());
            forces.fill(Vector3::zeros());
            let (mut report, mut scratch) = (BatchReport::default(), scratch());
            for batch in &batches[part.batches.clone()] {
                let results = &mut results[..batch.packs.len()];
                report = report.merged(compute(batch, &mut scratch, results).shifted(batch.elements.start as u32));
                lists.scatter(batch.packs.clone(), results, blocks, forces);
            }
            report
        };
        if let [whole] = lists.parts() {
            let report = part(whole, results, upper, f_int);
            lists.finish(0, upper);
            return report;
        }
        let blocks = if upper.is_empty() { &mut [] } else { &mut *part_blocks };
        let report = side_by_side(lists.parts(), size, results, blocks, part_forces, parallel, &part);
        let gather_blocks = |(k, upper): (usize, &mut [Matrix3<f64>])| {
            lists.gather_blocks(k * CHUNK, part_blocks, upper);
            lists.finish(k * CHUNK, upper);
        };
        let gather_forces = |(k, f_int): (usize, &mut [Vector3<f64>])| {
            lists.gather_forces(k * CHUNK, part_forces, f_int);
        };
        if parallel {
            upper.par_chunks_mut(CHUNK).enumerate().for_each(gather_blocks);
            f_int.par_chunks_mut(CHUNK).enumerate().for_each(gather_forces);
        } else {
            upper.chunks_mut(CHUNK).enumerate().for_each(gather_blocks);
            f_int.chunks_mut(CHUNK).enumerate().for_each(gather_forces);
        }
        report
    }
}

/// Calls `part` for each of some parts, in parallel or one after the other, with its own room for results, its blocks (none
/// where only forces are asked for) and its forces.
fn side_by_side<R: Send>(
    parts: &[Part],
    size: usize,
    results: &mut [R],
    blocks: &mut [Matrix3<f64>],
    forces: &mut [Vector3<f64>],
    parallel: bool,
    part: &(impl Fn(&Part, &mut [R], &mut [Matrix3<f64>], &mut [Vector3<f64>]) -> BatchReport + Sync),
) -> BatchReport {
    if let [one] = parts {
        return part(one, results, blocks, forces);
    }
    let (low, high) = parts.split_at(parts.len() / 2);
    let [Some(first), Some(middle)] = [low.first(), high.first()] else { return BatchReport::default() };
    let (low_results, high_results) = results.split_at_mut(size * low.len());
    let (low_forces, high_forces) = forces.split_at_mut(middle.nodes.start - first.nodes.start);
    let at = if blocks.is_empty() { 0 } else { middle.blocks.start - first.blocks.start };
    let (low_blocks, high_blocks) = blocks.split_at_mut(at);
    let (low_report, high_report) = if parallel {
        rayon::join(
            || side_by_side(low, size, low_results, low_blocks, low_forces, true, part),
            || side_by_side(high, size, high_results, high_blocks, high_forces, true, part),
        )
    } else {
        (
            side_by_side(low, size, low_results, low_blocks, low_forces, false, part),
            side_by_side(high, size, high_results, high_blocks, high_forces, false, part),
        )
    };
    low_report.merged(high_report)
}
