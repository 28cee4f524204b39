//! Energy of a body, in parallel where there are threads and with the same bits for any number of them.

use std::ops::Range;

use nalgebra::Vector3;

use super::viscous::StepTissue;
use crate::{
    element::{ElementKind, quadratic::POINTS},
    model::{Batch, FemModel, FemState},
};

/// Batches that one task handles.
const BATCHES: usize = 4;

/// Elastic energy of the body (J); of viscous tissue, what it would be after an instantaneous deformation. Allocates nothing.
pub fn elastic_energy(model: &FemModel, state: &FemState) -> f64 {
    sum_energy(model, state, StepTissue::instantaneous)
}

/// The energy (J) whose derivative by `q` is minus the internal force at the end of a step `dt` (s), infinite for the relaxed
/// equilibrium. Of elastic bodies it is [`elastic_energy`]; of viscous ones it is less by what the step and the memory relax.
/// Allocates nothing.
pub fn incremental_energy(model: &FemModel, state: &FemState, dt: f64) -> f64 {
    sum_energy(model, state, |batch| StepTissue::new(batch, state, dt))
}

/// Sums the energy of all batches (J) and of the groups of averaged elements.
fn sum_energy<'a>(model: &'a FemModel, state: &FemState, tissue: impl Fn(&'a Batch) -> StepTissue<'a> + Sync) -> f64 {
    let batches = model.batches();
    let parallel = rayon::current_num_threads() > 1;
    let of_batch = |batch: &'a Batch| of_batch(model, batch, &tissue(batch), &state.q);
    let of_elements =
        sum_by_halves(0..batches.len(), BATCHES, parallel, &|range| batches[range].iter().map(of_batch).sum());
    of_elements + model.averaging().map_or(0.0, |groups| groups.energy(model.elements(), &state.q))
}

/// Energy of one batch (J).
fn of_batch(model: &FemModel, batch: &Batch, tissue: &StepTissue<'_>, q: &[Vector3<f64>]) -> f64 {
    let (mut energy, mut first) = (0.0, 0);
    if model.element_kind() == ElementKind::Quadratic {
        for pack in &model.quadratic_packs()[batch.packs.clone()] {
            for (k, at) in pack.at_points(q).iter().enumerate() {
                energy += tissue.pack_energy(at, |lane| POINTS * (first + lane) + k);
            }
            first += pack.len;
        }
        return energy;
    }
    for pack in &model.packs()[batch.packs.clone()] {
        energy += tissue.pack_energy(&pack.at(q), |lane| first + lane);
        first += pack.len;
    }
    energy
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
