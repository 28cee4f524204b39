//! Energy of a body, in parallel where there are threads and with the same bits for any number of them.

#![allow(non_snake_case)]

use std::ops::Range;

use nalgebra::Matrix3;

use super::viscous::StepTissue;
use crate::{
    element::{ElementKind, quadratic::POINTS},
    material::Law,
    model::{Batch, FemModel, FemState},
};

/// Batches that one task handles.
const BATCHES: usize = 4;

/// Elastic energy of the body (J); of viscous tissue, what it would be after an instantaneous deformation. Allocates nothing.
pub fn elastic_energy(model: &FemModel, state: &FemState) -> f64 {
    sum_energy(model, state, |batch| {
        let law = &batch.tissue.material;
        of_batch(
            model,
            state,
            batch,
            |_, F| law.energy_density(F),
            || law.packed_energy(&model.packs()[batch.packs.clone()], &state.q),
        )
    })
}

/// The energy (J) whose derivative by `q` is minus the internal force at the end of a step `dt` (s), infinite for the relaxed
/// equilibrium. Of elastic bodies it is [`elastic_energy`]; of viscous ones it is less by what the step and the memory relax.
/// Allocates nothing.
pub fn incremental_energy(model: &FemModel, state: &FemState, dt: f64) -> f64 {
    sum_energy(model, state, |batch| {
        let tissue = StepTissue::new(batch, state, dt);
        of_batch(
            model,
            state,
            batch,
            |point, F| tissue.energy_density(point, F),
            || tissue.packed_energy(&model.packs()[batch.packs.clone()], &state.q),
        )
    })
}

/// Sums the energy of all batches (J) and of the groups of averaged elements.
fn sum_energy(model: &FemModel, state: &FemState, energy: impl Fn(&Batch) -> f64 + Sync) -> f64 {
    let batches = model.batches();
    let parallel = rayon::current_num_threads() > 1;
    let of_elements =
        sum_by_halves(0..batches.len(), BATCHES, parallel, &|range| batches[range].iter().map(&energy).sum());
    of_elements + model.averaging().map_or(0.0, |groups| groups.energy(model.elements(), &state.q))
}

/// Energy of one batch (J): by `density` (J/m³) at point and deformation gradient, or `packed` for linear elements.
fn of_batch(
    model: &FemModel,
    state: &FemState,
    batch: &Batch,
    density: impl Fn(usize, &Matrix3<f64>) -> f64,
    packed: impl Fn() -> f64,
) -> f64 {
    match model.element_kind() {
        ElementKind::Linear => packed(),
        ElementKind::Averaged => {
            let elements = batch.of(model.elements()).iter().enumerate();
            elements.map(|(e, element)| element.volume * density(e, &element.deformation_gradient(&state.q))).sum()
        }
        ElementKind::Quadratic => {
            let mut energy = 0.0;
            for (e, element) in batch.of(model.quadratic_elements()).iter().enumerate() {
                let points = element.deformation_gradients(&state.q);
                for (k, (F, weight)) in points.iter().zip(element.weights).enumerate() {
                    energy += weight * density(e * POINTS + k, F);
                }
            }
            energy
        }
    }
}

/// Sums over a range cut into halves until at most `few` are left: where it is cut, and with it every bit of the sum, does
/// not depend on whether the halves are summed in `parallel`.
pub(crate) fn sum_by_halves(
    range: Range<usize>,
    few: usize,
    parallel: bool,
    sum: &(impl Fn(Range<usize>) -> f64 + Sync),
) -> f64 {
    if range.len() <= few {
        return sum(range);
    }
    let middle = range.start + range.len() / 2;
    let (low, high) = (range.start..middle, middle..range.end);
    let (low, high) = if parallel {
        rayon::join(|| sum_by_halves(low, few, true, sum), || sum_by_halves(high, few, true, sum))
    } else {
        (sum_by_halves(low, few, false, sum), sum_by_halves(high, few, false, sum))
    };
    low + high
}
