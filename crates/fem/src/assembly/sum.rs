//! The elements' forces and blocks, computed batch by batch and summed over the body.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::{AssemblyReport, FemWorkspace, ROWS, ScatterLists, viscous::StepTissue};
use crate::{
    element::{
        ElementKind, ElementMatrices, NodalShares, Tetrahedron, UNIT,
        quadratic::{POINTS, QuadraticMatrices, quadratic_batch, quadratic_forces},
    },
    material::BatchReport,
    model::{Batch, FemModel, FemState},
    rotation::cofactor,
};

/// Computes all elements and sums them into `ws.upper` and `ws.f_int`; `dt` (s) is the step that viscous tissue relaxes in.
pub(super) fn sum_elements(model: &FemModel, state: &FemState, dt: f64, ws: &mut FemWorkspace) -> AssemblyReport {
    let (q, filter) = (&state.q, ws.filter);
    let parallel = !ws.slot.is_empty() && rayon::current_num_threads() > 1;
    if let Some(groups) = model.averaging() {
        groups.pressures(model.elements(), q, filter, parallel, &mut ws.averaging);
    }
    let pressures = &ws.averaging.pressures;
    let sums = Sums {
        batches: model.batches(),
        size: model.batch_size(),
        scatter: model.scatter(),
        slot: &ws.slot,
        parallel,
        upper: &mut ws.upper,
        f_int: &mut ws.f_int,
    };
    let averaging = &ws.averaging;
    let report = match model.element_kind() {
        ElementKind::Linear => model.pack_lists().fill(
            model.packs(),
            model.batches(),
            &mut ws.pack_results,
            parallel,
            (&mut ws.upper, &mut ws.f_int),
            |batch, packs, results| StepTissue::new(batch, state, dt).packed(packs, q, filter, results),
        ),
        ElementKind::Quadratic => sums.fill(&mut ws.quadratic_results, |batch, results: &mut [QuadraticMatrices]| {
            let tissue = StepTissue::new(batch, state, dt);
            let answer = |k: usize, p: usize, F: &Matrix3<f64>, out: &mut ElementMatrices| {
                tissue.element(k * POINTS + p, &UNIT, F, filter, out)
            };
            quadratic_batch(batch.of(model.quadratic_elements()), q, answer, results)
        }),
        ElementKind::Averaged => sums.fill(&mut ws.results, |batch, results: &mut [ElementMatrices]| {
            let tissue = StepTissue::new(batch, state, dt);
            let dropped = |k| model.averaging().is_some_and(|g| g.is_dropped(batch.elements.start + k, averaging));
            pressure_batch(&tissue, batch.of(model.elements()), batch.of(pressures), q, (filter, dropped), results)
        }),
    };
    if let Some(groups) = model.averaging() {
        groups.add_blocks(model.elements(), q, parallel, &mut ws.averaging, &mut ws.upper);
    }
    AssemblyReport::new(report, model)
}

/// Forces and exact tangents of elements under pressures; `dropped` tells of elements in a group that the filter drops.
fn pressure_batch(
    tissue: &StepTissue<'_>,
    elements: &[Tetrahedron],
    pressures: &[f64],
    q: &[Vector3<f64>],
    (filter, dropped): (bool, impl Fn(usize) -> bool),
    out: &mut [ElementMatrices],
) -> BatchReport {
    let mut report = BatchReport::default();
    for (k, ((element, &pressure), out)) in elements.iter().zip(pressures).zip(out).enumerate() {
        let edges = element.edges(q);
        let filtered = tissue.element_under_pressure(k, element, &edges, pressure, filter, out) | dropped(k);
        report.note(k as u32, edges.determinant() / (6.0 * element.volume), filtered, out.is_finite());
    }
    report
}

/// Computes the forces of all elements and sums them into `ws.f_int`; `dt` as for [`sum_elements`].
pub(super) fn sum_forces(model: &FemModel, state: &FemState, dt: f64, ws: &mut FemWorkspace) -> AssemblyReport {
    let q = &state.q;
    let parallel = !ws.slot.is_empty() && rayon::current_num_threads() > 1;
    if let Some(groups) = model.averaging() {
        groups.pressures(model.elements(), q, false, parallel, &mut ws.averaging);
    }
    let pressures = &ws.averaging.pressures;
    let sums = Sums {
        batches: model.batches(),
        size: model.batch_size(),
        scatter: model.scatter(),
        slot: &ws.slot,
        parallel,
        upper: &mut [],
        f_int: &mut ws.f_int,
    };
    let report = match model.element_kind() {
        ElementKind::Linear => model.pack_lists().fill(
            model.packs(),
            model.batches(),
            &mut ws.pack_results,
            parallel,
            (&mut [], &mut ws.f_int),
            |batch, packs, results| StepTissue::new(batch, state, dt).packed_forces(packs, q, results),
        ),
        ElementKind::Quadratic => sums.fill(&mut ws.quadratic_results, |batch, results: &mut [QuadraticMatrices]| {
            let tissue = StepTissue::new(batch, state, dt);
            let stress = |k: usize, p: usize, F: &Matrix3<f64>| tissue.first_piola(k * POINTS + p, F);
            quadratic_forces(batch.of(model.quadratic_elements()), q, stress, results)
        }),
        ElementKind::Averaged => sums.fill(&mut ws.results, |batch, results: &mut [ElementMatrices]| {
            let tissue = StepTissue::new(batch, state, dt);
            pressure_forces(&tissue, batch.of(model.elements()), batch.of(pressures), q, results)
        }),
    };
    AssemblyReport::new(report, model)
}

/// The forces of [`pressure_batch`] alone.
fn pressure_forces(
    tissue: &StepTissue<'_>,
    elements: &[Tetrahedron],
    pressures: &[f64],
    q: &[Vector3<f64>],
    out: &mut [ElementMatrices],
) -> BatchReport {
    let mut report = BatchReport::default();
    for (k, ((element, &pressure), out)) in elements.iter().zip(pressures).zip(out).enumerate() {
        let edges = element.edges(q);
        let P = tissue.first_piola(k, &(edges * element.inverse_rest_edges));
        out.forces = element.forces(&P) + cofactor(&edges) * (-pressure / 6.0);
        let J = edges.determinant() / (6.0 * element.volume);
        report.note(k as u32, J, false, out.forces.iter().all(|f| f.is_finite()));
    }
    report
}

/// What the results of the elements are summed into, and by which lists.
struct Sums<'a> {
    batches: &'a [Batch],
    /// Results that a batch may have.
    size: usize,
    scatter: &'a ScatterLists,
    /// Slot of each element among the results; empty on one thread.
    slot: &'a [u32],
    parallel: bool,
    upper: &'a mut [Matrix3<f64>],
    f_int: &'a mut [Vector3<f64>],
}

impl Sums<'_> {
    /// Sums what `compute` puts into the results of each batch.
    fn fill<R: NodalShares + Send + Sync>(
        self,
        results: &mut [R],
        compute: impl Fn(&Batch, &mut [R]) -> BatchReport + Sync,
    ) -> BatchReport {
        let compute = |batch: &Batch, results: &mut [R]| {
            compute(batch, &mut results[..batch.elements.len()]).shifted(batch.elements.start as u32)
        };
        let Self { batches, size, scatter, slot, parallel, upper, f_int } = self;
        if !parallel {
            upper.fill(Matrix3::zeros());
            f_int.fill(Vector3::zeros());
            let mut report = BatchReport::default();
            for batch in batches {
                report = report.merged(compute(batch, results));
                scatter.scatter(batch.elements.start, &results[..batch.elements.len()], upper, f_int);
            }
            return report;
        }
        let report = (results.par_chunks_mut(size).zip(batches))
            .map(|(results, batch)| compute(batch, results))
            .reduce(BatchReport::default, BatchReport::merged);
        let results = &*results;
        upper.par_chunks_mut(8 * ROWS).enumerate().for_each(|(chunk, upper)| {
            for (k, block) in upper.iter_mut().enumerate() {
                *block = scatter.gather_block(8 * ROWS * chunk + k, results, slot);
            }
        });
        f_int.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, f_int)| {
            for (k, f) in f_int.iter_mut().enumerate() {
                *f = scatter.gather_force(ROWS * chunk + k, results, slot);
            }
        });
        report
    }
}
