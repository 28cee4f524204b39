//! Tissue that has passed through itself: found, named in every step, and led home.
//!
//! Crushed or twisted, tissue can slip through itself and come to rest with every element open, wound twice round inner
//! edges ([`Windings`]): forces balance, and no iteration by its law leads out. The body is looked through at the begin of
//! its first step, and from when the guard acts or an element is inside out until it is found whole;
//! [`StepReport::tangle`] names what is found.
//!
//! A body that rests so, inside out or held open, and is not touched by the tool, is led: until it rests anew it answers as
//! linear elasticity with
//! the shear moduli of its tissue. Its energy is convex, so that between the same ends one equilibrium is all there is,
//! which without loads on undisplaced ends is the place of rest; from near there the own law takes over. Where that is not
//! enough (the ends themselves are twisted, say), the body is led again after [`GROWTH`] times as many steps at rest.

use nalgebra::Vector3;
use palpate_fem::assembly::Windings;

use super::correction::failed_element;
use super::held_open::AT_REST;
use super::report::Tangle;
use super::{StepReport, StepState, StepWorkspace};
use crate::world::{Integration, World};

/// Steps at rest in a tangle before the body is led: what still moves may come free on its own, and was led no better (two
/// seconds in trouble without rest as a second reason led 11 more of 390 cases and none that was lost).
const PATIENCE: u32 = 10;

/// Factor from one attempt to the next.
const GROWTH: u32 = 4;

/// Most attempts that count: from then on the wait is `10 * 4^6` steps, 23 minutes at 30 Hz.
const MOST_ATTEMPTS: u32 = 6;

/// Most steps of one attempt: a second at 30 Hz. From a full twist the way takes 6 or 7.
const LONGEST: u32 = 30;

/// Steps without trouble after which attempts are forgotten.
const FORGOTTEN: u64 = 30;

/// What is remembered of a body in trouble.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trouble {
    /// Whether it may have passed through itself since it was last found whole.
    pub(super) suspected: bool,
    /// Steps in a row that it has rested in a tangle.
    rested: u32,
    /// Steps that it has been led; 0 where it is not.
    led: u32,
    /// How often it was led in this trouble.
    attempts: u32,
    /// The last step in which it was suspected.
    last: u64,
}

impl Trouble {
    /// Before the first step: the body may begin in a tangle.
    pub(super) const UNKNOWN: Self = Self { suspected: true, rested: 0, led: 0, attempts: 0, last: 0 };

    /// Whether the next step is to lead the body.
    pub(super) fn leads(&self) -> bool {
        self.led > 0
    }
}

/// Memory to look for tangles in a body that is guarded.
pub(super) fn windings(world: &World) -> Option<Windings> {
    let guarded = world.description().bodies[0].guard && *world.integration() == Integration::BackwardEuler;
    guarded.then(|| Windings::new(world.model()))
}

/// Looks for tangles at the begin of the step, and decides whether the next is led.
pub(super) fn look(world: &World, state: &mut StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(windings) = &mut ws.windings else { return };
    let inside_out = report.assembly.inverted > 0 || report.folds.folded > 0;
    state.trouble.suspected |= inside_out;
    if !state.trouble.suspected || report.assembly.non_finite.is_some() {
        return;
    }
    let found = windings.find(world.model(), &state.fem.q);
    if found.edges > 0 {
        let place = failed_element(world, state, Some(found.tetrahedron));
        report.tangle = place.map(|place| Tangle { edges: found.edges, winding: found.winding, place });
    }
    let farthest = state.fem.v.iter().map(Vector3::norm).fold(0.0, f64::max) * ws.dt;
    let rests = farthest < AT_REST * ws.size;
    let touched = !state.warm_start.is_empty();
    let trouble = &mut state.trouble;
    if trouble.last + FORGOTTEN < report.step {
        trouble.attempts = 0;
    }
    trouble.last = report.step;
    if trouble.leads() {
        // The begin of the first step is at rest as well.
        let home = rests && trouble.led > 1;
        trouble.led += 1;
        if touched || home || trouble.led > LONGEST {
            trouble.attempts += u32::from(!touched && trouble.attempts < MOST_ATTEMPTS);
            trouble.led = 0;
        }
        return;
    }
    trouble.suspected = found.edges > 0 || inside_out;
    trouble.rested = if trouble.suspected && rests && !touched { trouble.rested + 1 } else { 0 };
    // The linear law has one equilibrium anyway.
    if trouble.rested >= PATIENCE * GROWTH.pow(trouble.attempts) && !world.plan().constant {
        (trouble.led, trouble.rested) = (1, 0);
    }
}
