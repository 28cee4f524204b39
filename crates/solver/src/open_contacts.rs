//! Contacts that are open at the answer of an interior point, which leaves a little force on every contact.
//!
//! Whoever reads the forces takes a contact with a force for a closed one: the tick holds bodies there.

use nalgebra::Vector3;
use palpate_constraints::law::natural_stiffness;

use crate::problem::{ProblemView, gather, scatter};

/// Takes the force off every block whose natural map has none at these gaps (m): `P(λ - ρ δ) = 0`. The residual of such a block
/// becomes zero; it was what the force is by then. Returns whether there was one.
pub(crate) fn release(view: &ProblemView<'_>, delta: &[f64], lambda: &mut [f64]) -> bool {
    let mut released = false;
    for block in view.blocks {
        let (gap, force) = (gather(delta, block), gather(lambda, block));
        let rho = natural_stiffness(&view.diagonal_block(block), block.law.rows());
        let shifted = force - block.law.corrected_gap(&gap) * rho;
        let is_open = shifted.iter().all(|x| x.is_finite()) && block.law.project(&shifted) == Vector3::zeros();
        if is_open && force != Vector3::zeros() {
            scatter(&Vector3::zeros(), block, lambda);
            released = true;
        }
    }
    released
}

/// Forms the gap (m) at the forces, less those on open contacts.
pub(crate) fn form_gap_of_closed(view: &ProblemView<'_>, lambda: &mut [f64], delta: &mut [f64]) {
    view.gap(lambda, delta);
    if release(view, delta, lambda) {
        view.gap(lambda, delta);
    }
}
