//! The tissue of a batch over one step: its law, or with viscosity the law as it relaxes in the step and what it remembers.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3, Vector6};

use crate::{
    element::{ElementKind, ElementMatrices, Tetrahedron, quadratic::POINTS},
    material::{
        BatchReport, Law, Material,
        viscosity::{Relaxation, add_memory},
    },
    model::{Batch, FemModel, FemState},
    pack::{Pack, PackMatrices},
};

/// A batch's tissue over one step. Points are counted from the batch's first: elements, or their points of quadrature.
pub(super) struct StepTissue<'a> {
    /// The law, relaxed by the step.
    law: Material,
    relaxation: Relaxation<'a>,
    memory: &'a [Vector6<f64>],
}

impl<'a> StepTissue<'a> {
    /// The tissue over a step `dt` (s); infinity for the relaxed equilibrium.
    pub(super) fn new(batch: &'a Batch, state: &'a FemState, dt: f64) -> Self {
        let relaxation = Relaxation { terms: &batch.tissue.viscosity, dt };
        let law = batch.tissue.material;
        Self {
            law: if relaxation.terms.is_empty() { law } else { law.relaxed(relaxation.share()) },
            relaxation,
            memory: state.memory.get(batch.memory.clone()).unwrap_or_default(),
        }
    }

    /// `Γ` of a point (Pa); none in elastic tissue.
    fn remembered(&self, point: usize) -> Option<Matrix3<f64>> {
        let terms = self.relaxation.terms.len();
        let history = self.memory.get(point * terms..(point + 1) * terms)?;
        (terms > 0).then(|| self.relaxation.memory(history))
    }

    /// [`Law::packed`] for the linear elements of the batch.
    pub(super) fn packed(
        &self,
        packs: &[Pack],
        q: &[Vector3<f64>],
        filter: bool,
        out: &mut [PackMatrices],
    ) -> BatchReport {
        let mut report = self.law.packed(packs, q, filter, out);
        if self.relaxation.terms.is_empty() {
            return report;
        }
        let mut point = 0;
        for (pack, out) in packs.iter().zip(out) {
            for lane in 0..pack.len {
                let (element, mut matrices) = (pack.element(lane), out.element(lane));
                let acted = self.add_memory(point, &element, &element.edges(q), filter, &mut matrices);
                report.filtered += u32::from(acted && out.filtered[lane] == 0.0);
                if report.non_finite.is_none() && !matrices.is_finite() {
                    report.non_finite = Some(point as u32);
                }
                out.set_element(lane, &matrices);
                point += 1;
            }
        }
        report
    }

    /// [`Law::packed_forces`] for the linear elements of the batch.
    pub(super) fn packed_forces(&self, packs: &[Pack], q: &[Vector3<f64>], out: &mut [PackMatrices]) -> BatchReport {
        let mut report = self.law.packed_forces(packs, q, out);
        if self.relaxation.terms.is_empty() {
            return report;
        }
        let mut point = 0;
        for (pack, out) in packs.iter().zip(out) {
            for lane in 0..pack.len {
                if let Some(memory) = self.remembered(point) {
                    let element = pack.element(lane);
                    out.add_forces(lane, &element.forces(&(element.deformation_gradient(q) * -memory)));
                }
                if report.non_finite.is_none() && !out.forces[0].iter().all(|row| row[lane].is_finite()) {
                    report.non_finite = Some(point as u32);
                }
                point += 1;
            }
        }
        report
    }

    /// Energy of the linear elements of the batch (J), as [`StepTissue::energy_density`].
    pub(super) fn packed_energy(&self, packs: &[Pack], q: &[Vector3<f64>]) -> f64 {
        let mut energy = self.law.packed_energy(packs, q);
        let elements = packs.iter().flat_map(|pack| (0..pack.len).map(|lane| pack.element(lane)));
        for (point, element) in elements.enumerate() {
            let Some(memory) = self.remembered(point) else { break };
            energy -= element.volume * remembered_energy(&memory, &element.deformation_gradient(q));
        }
        energy
    }

    /// [`Law::element`] for a point.
    pub(super) fn element(
        &self,
        point: usize,
        element: &Tetrahedron,
        edges: &Matrix3<f64>,
        filter: bool,
        out: &mut ElementMatrices,
    ) -> bool {
        self.law.element(element, edges, filter, out) | self.add_memory(point, element, edges, filter, out)
    }

    /// [`Law::element_under_pressure`] for a point. Set-up takes only laws that have an answer.
    pub(super) fn element_under_pressure(
        &self,
        point: usize,
        element: &Tetrahedron,
        edges: &Matrix3<f64>,
        pressure: f64,
        filter: bool,
        out: &mut ElementMatrices,
    ) -> bool {
        let filtered = self.law.element_under_pressure(element, edges, pressure, filter, out).unwrap_or_default();
        filtered | self.add_memory(point, element, edges, filter, out)
    }

    fn add_memory(
        &self,
        point: usize,
        element: &Tetrahedron,
        edges: &Matrix3<f64>,
        filter: bool,
        out: &mut ElementMatrices,
    ) -> bool {
        self.remembered(point)
            .is_some_and(|memory| add_memory(element, &(edges * element.inverse_rest_edges), &memory, filter, out))
    }

    /// First Piola stress of a point (Pa).
    pub(super) fn first_piola(&self, point: usize, F: &Matrix3<f64>) -> Matrix3<f64> {
        let P = self.law.first_piola(F);
        self.remembered(point).map_or(P, |memory| P - F * memory)
    }

    /// What a step minimises at a point (J/m³).
    pub(super) fn energy_density(&self, point: usize, F: &Matrix3<f64>) -> f64 {
        self.law.energy_density(F) - self.remembered(point).map_or(0.0, |memory| remembered_energy(&memory, F))
    }
}

/// `Γ : (C - I)/2` (J/m³).
fn remembered_energy(memory: &Matrix3<f64>, F: &Matrix3<f64>) -> f64 {
    memory.dot(&((F.transpose() * F - Matrix3::identity()) * 0.5))
}

/// Takes the memory of viscous tissue over a step `dt` (s) that has ended in `state.q`. Once per accepted step, after it;
/// with `dt` infinite the tissue is relaxed where it is. Elastic bodies have nothing to do.
///
/// Allocates nothing; the same bits for any number of threads.
pub fn advance_memory(model: &FemModel, state: &mut FemState, dt: f64) {
    let FemState { q, memory, .. } = state;
    if rayon::current_num_threads() > 1 {
        return advance(model, model.batches(), q, dt, memory);
    }
    for batch in model.batches() {
        let memory = memory.get_mut(batch.memory.clone()).unwrap_or_default();
        advance_batch(model, batch, q, dt, memory);
    }
}

/// Halves the batches until one is left, so that no task list is needed. `memory` is theirs.
fn advance(model: &FemModel, batches: &[Batch], q: &[Vector3<f64>], dt: f64, memory: &mut [Vector6<f64>]) {
    match batches {
        _ if memory.is_empty() => {}
        [] => {}
        [batch] => advance_batch(model, batch, q, dt, memory),
        _ => {
            let (left, right) = batches.split_at(batches.len() / 2);
            let middle: usize = left.iter().map(|batch| batch.memory.len()).sum();
            let Some((low, high)) = memory.split_at_mut_checked(middle) else { return };
            rayon::join(|| advance(model, left, q, dt, low), || advance(model, right, q, dt, high));
        }
    }
}

fn advance_batch(model: &FemModel, batch: &Batch, q: &[Vector3<f64>], dt: f64, memory: &mut [Vector6<f64>]) {
    let (law, terms) = (&batch.tissue.material, &batch.tissue.viscosity);
    if terms.is_empty() {
        return;
    }
    let relaxation = Relaxation { terms, dt };
    if model.element_kind() == ElementKind::Quadratic {
        let elements = batch.of(model.quadratic_elements()).iter();
        for (element, memory) in elements.zip(memory.chunks_exact_mut(POINTS * terms.len())) {
            let points = element.deformation_gradients(q);
            for (F, memory) in points.iter().zip(memory.chunks_exact_mut(terms.len())) {
                relaxation.advance(law, F, memory);
            }
        }
        return;
    }
    for (element, memory) in batch.of(model.elements()).iter().zip(memory.chunks_exact_mut(terms.len())) {
        relaxation.advance(law, &element.deformation_gradient(q), memory);
    }
}
