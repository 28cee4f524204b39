//! The tissue of a batch over one step: its law, or with viscosity the law as it relaxes in the step and what it remembers.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3, Vector6};

use super::sum::Wanted;
use crate::{
    element::{ElementKind, quadratic::POINTS},
    material::{
        Law, Linear, Material,
        viscosity::{Relaxation, add_memory},
    },
    model::{Batch, FemModel, FemState},
    pack::{DeformedPack, PackMatrices},
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

    /// The tissue as it answers an instantaneous deformation.
    pub(super) fn instantaneous(batch: &'a Batch) -> Self {
        Self { law: batch.tissue.material, relaxation: Relaxation { terms: &[], dt: 0.0 }, memory: &[] }
    }

    /// Linear elasticity with the shear modulus of the tissue; of averaged tissue the volume term is elsewhere, and so the
    /// other modulus is one for all, `λ = μ`.
    pub(super) fn led(batch: &'a Batch) -> Self {
        let mu = batch.tissue.material.small_strain().mu;
        let law = Linear::from_young_poisson(2.5 * mu, 0.25).into();
        Self { law, relaxation: Relaxation { terms: &[], dt: 0.0 }, memory: &[] }
    }

    /// `Γ` of a point (Pa); none in elastic tissue.
    fn remembered(&self, point: usize) -> Option<Matrix3<f64>> {
        let terms = self.relaxation.terms.len();
        let history = self.memory.get(point * terms..(point + 1) * terms)?;
        (terms > 0).then(|| self.relaxation.memory(history))
    }

    /// [`Law::pack`] or [`Law::pack_forces`] for elements, or their points of quadrature, of which `point` tells the number
    /// from the place in the pack.
    pub(super) fn pack(
        &self,
        at: &DeformedPack<'_>,
        point: impl Fn(usize) -> usize,
        wanted: Wanted,
        out: &mut PackMatrices,
    ) {
        match wanted {
            Wanted::Forces => self.law.pack_forces(at, out),
            Wanted::Tangents { filter } => self.law.pack(at, filter, out),
        }
        for lane in 0..at.rest.len {
            let Some(memory) = self.remembered(point(lane)) else { break };
            let element = at.rest.element(lane);
            let F = at.edges_of(lane) * element.inverse_rest_edges;
            let Wanted::Tangents { filter } = wanted else {
                out.add_forces(lane, &element.forces(&(F * -memory)));
                continue;
            };
            let mut matrices = out.element(lane);
            if add_memory(&element, &F, &memory, filter, &mut matrices) {
                out.filtered[lane] = 1.0;
            }
            out.set_element(lane, &matrices);
            if !matrices.is_finite() {
                out.checksum[lane] = f64::NAN;
            }
        }
    }

    /// Energy of the elements of a pack or their points (J): what a step minimises. `point` as for [`StepTissue::pack`].
    pub(super) fn pack_energy(&self, at: &DeformedPack<'_>, point: impl Fn(usize) -> usize) -> f64 {
        let mut energy = self.law.pack_energies(at).iter().take(at.rest.len).sum();
        for lane in 0..at.rest.len {
            let Some(memory) = self.remembered(point(lane)) else { break };
            let element = at.rest.element(lane);
            let F = at.edges_of(lane) * element.inverse_rest_edges;
            energy -= element.volume * memory.dot(&((F.transpose() * F - Matrix3::identity()) * 0.5));
        }
        energy
    }
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
