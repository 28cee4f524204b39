//! The elements' forces and blocks, computed batch by batch and summed over the body.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use super::{
    AssemblyReport, FemWorkspace,
    destination::{Elements, Sums, is_parallel},
    packed::Packs,
    viscous::StepTissue,
};
use crate::{
    element::{
        ElementKind, ElementMatrices, Tetrahedron, UNIT,
        quadratic::{POINTS, QuadraticMatrices, quadratic_batch, quadratic_forces},
    },
    material::{BATCH, BatchReport},
    model::{FemModel, FemState},
    pack::PACK,
    rotation::cofactor,
};

/// Computes all elements and sums them into `ws.upper` and `ws.f_int`; `dt` (s) is the step that viscous tissue relaxes in.
pub(super) fn sum_elements(model: &FemModel, state: &FemState, dt: f64, ws: &mut FemWorkspace) -> AssemblyReport {
    let (q, filter, parallel) = (&state.q, ws.filter, is_parallel(ws));
    if let Some(groups) = model.averaging() {
        groups.pressures(model.elements(), q, filter, parallel, &mut ws.averaging);
    }
    let averaging = &ws.averaging;
    let sums = Sums { batches: model.batches(), parallel, upper: &mut ws.upper, f_int: &mut ws.f_int };
    let (packs, elements) = destinations(model, &ws.slot);
    let size = model.batch_size();
    let report = match model.element_kind() {
        ElementKind::Linear => sums.fill(&packs, BATCH / PACK, &mut ws.pack_results, |batch, results| {
            StepTissue::new(batch, state, dt).packed(&model.packs()[batch.packs.clone()], q, filter, results)
        }),
        ElementKind::Quadratic => {
            sums.fill(&elements, size, &mut ws.quadratic_results, |batch, results: &mut [QuadraticMatrices]| {
                let tissue = StepTissue::new(batch, state, dt);
                let answer = |k: usize, p: usize, F: &Matrix3<f64>, out: &mut ElementMatrices| {
                    tissue.element(k * POINTS + p, &UNIT, F, filter, out)
                };
                quadratic_batch(batch.of(model.quadratic_elements()), q, answer, results)
            })
        }
        ElementKind::Averaged => {
            sums.fill(&elements, size, &mut ws.results, |batch, results: &mut [ElementMatrices]| {
                let tissue = StepTissue::new(batch, state, dt);
                let dropped = |k| model.averaging().is_some_and(|g| g.is_dropped(batch.elements.start + k, averaging));
                let pressures = batch.of(&averaging.pressures);
                pressure_batch(&tissue, batch.of(model.elements()), pressures, q, (filter, dropped), results)
            })
        }
    };
    if let Some(groups) = model.averaging() {
        groups.add_blocks(model.elements(), q, parallel, &mut ws.averaging, &mut ws.upper);
    }
    ws.folds.add(model, q, filter, &mut ws.upper, &mut ws.f_int);
    AssemblyReport::new(report, model)
}

/// Where the results of packs and of single elements go.
fn destinations<'a>(model: &'a FemModel, slot: &'a [u32]) -> (Packs<'a>, Elements<'a>) {
    (Packs { lists: model.pack_lists(), packs: model.packs() }, Elements { lists: model.scatter(), slot })
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
    let (q, parallel) = (&state.q, is_parallel(ws));
    if let Some(groups) = model.averaging() {
        groups.pressures(model.elements(), q, false, parallel, &mut ws.averaging);
    }
    let pressures = &ws.averaging.pressures;
    let sums = Sums { batches: model.batches(), parallel, upper: &mut [], f_int: &mut ws.f_int };
    let (packs, elements) = destinations(model, &ws.slot);
    let size = model.batch_size();
    let report = match model.element_kind() {
        ElementKind::Linear => sums.fill(&packs, BATCH / PACK, &mut ws.pack_results, |batch, results| {
            StepTissue::new(batch, state, dt).packed_forces(&model.packs()[batch.packs.clone()], q, results)
        }),
        ElementKind::Quadratic => {
            sums.fill(&elements, size, &mut ws.quadratic_results, |batch, results: &mut [QuadraticMatrices]| {
                let tissue = StepTissue::new(batch, state, dt);
                let stress = |k: usize, p: usize, F: &Matrix3<f64>| tissue.first_piola(k * POINTS + p, F);
                quadratic_forces(batch.of(model.quadratic_elements()), q, stress, results)
            })
        }
        ElementKind::Averaged => {
            sums.fill(&elements, size, &mut ws.results, |batch, results: &mut [ElementMatrices]| {
                let tissue = StepTissue::new(batch, state, dt);
                pressure_forces(&tissue, batch.of(model.elements()), batch.of(pressures), q, results)
            })
        }
    };
    ws.folds.add(model, q, false, &mut [], &mut ws.f_int);
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
