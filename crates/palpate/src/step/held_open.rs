//! Elements that are held open: quadratic ones that fold, and others that have come to rest inside out.
//!
//! Tissue that slipped through itself can rest with an element inside out: at a minimum of the continued energy no
//! iteration leads out of it. So once linear or averaged tissue that the tool does not touch begins a step with inverted elements and hardly moves, they are
//! held open by the barrier of [`Folds`](palpate_fem::assembly::Folds), [`GROWTH`] times as stiff after each further step that
//! leaves one inverted and at rest, and no longer once all elements are above [`OPEN_BELOW`]. The body then comes back, or
//! rests with elements between 0 and [`OPEN_BELOW`], which every step's report counts
//! ([`StepReport::folds`]).

use nalgebra::Vector3;
use palpate_fem::assembly::{OPEN_BELOW, assemble};
use palpate_fem::element::ElementKind;

use super::{StepReport, StepState, StepWorkspace};
use crate::world::World;

/// Volume ratio of a quadratic element at its points above which it is not looked at for folds: where it is uneven enough
/// to be folded at a node, it is below this at the point next to it.
const EVEN: f64 = 0.7;

/// Motion of a node in one step, relative to the size of the body, below which inverted tissue counts as resting.
pub(super) const AT_REST: f64 = 1e-3;

/// Factor between the stiffness of the barrier in one step at rest and in the next.
const GROWTH: f64 = 4.0;

/// Most growths: to `4^7 = 1.6e4` times the element's own modulus, more than the largest ratio between tissues.
const MOST_GROWTHS: u32 = 7;

/// Holds open what needs it at the begin of the step, and assembles anew where there is any.
pub(super) fn hold_open(world: &World, state: &mut StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    if ws.rescue.is_none() || report.led {
        return;
    }
    let stiffness = if world.model().element_kind() == ElementKind::Quadratic {
        // Written so that NaN is even: such a step fails for its own reason.
        let uneven = report.assembly.min_jacobian < EVEN;
        if !uneven {
            return;
        }
        1.0
    } else {
        // Tissue under the tool is not at rest, whatever its speed.
        if !state.warm_start.is_empty() {
            state.stuck = 0;
            return;
        }
        watch(state, ws, report);
        if state.stuck == 0 {
            return;
        }
        GROWTH.powi(state.stuck as i32 - 1)
    };
    report.folds = ws.fem.folds.find(world.model(), &state.fem.q);
    ws.fem.folds.stiffen(stiffness);
    if report.folds.folded > 0 {
        report.assembly = assemble(world.model(), &state.fem, ws.dt, &[], &mut ws.fem);
    }
}

/// Counts the steps in which the body rested inside out; forgets them once all of it is open.
fn watch(state: &mut StepState, ws: &StepWorkspace, report: &StepReport) {
    let farthest = || state.fem.v.iter().map(Vector3::norm).fold(0.0, f64::max) * ws.dt;
    if report.assembly.inverted == 0 {
        if report.assembly.min_jacobian >= OPEN_BELOW {
            state.stuck = 0;
        }
    } else if farthest() < AT_REST * ws.size {
        state.stuck = (state.stuck + 1).min(MOST_GROWTHS + 1);
    }
}
