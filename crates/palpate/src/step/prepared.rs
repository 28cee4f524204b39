//! Bodies that are ready to be passed to: the scratch of each, and changes from outside on their way to a step.

use std::sync::Arc;
use std::sync::mpsc::Receiver;

use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::detection::DetectionWorkspace;
use palpate_fem::assembly::{FemWorkspace, Windings};

use super::tangle::windings;
use super::{StepState, StepWorkspace};
use crate::world::{Change, World};

/// The part of the step's scratch that belongs to one body.
pub(super) struct PhaseScratch {
    pub(super) fem: FemWorkspace,
    pub(super) geometry: SurfaceGeometry,
    pub(super) detection: DetectionWorkspace,
    pub(super) windings: Option<Windings>,
}

impl PhaseScratch {
    pub(super) fn new(change: &Change) -> Self {
        Self {
            fem: FemWorkspace::new(change.world().model()),
            geometry: change.world().geometry().clone(),
            detection: DetectionWorkspace::new(change.world().geometry()),
            windings: windings(change.world()),
        }
    }
}

/// A change from outside with the memory that its body takes, ready to be taken by a step.
pub(crate) struct Prepared {
    pub(super) change: Arc<Change>,
    pub(super) scratch: PhaseScratch,
}

impl Prepared {
    pub(crate) fn new(change: Arc<Change>) -> Self {
        Self { scratch: PhaseScratch::new(&change), change }
    }
}

impl StepWorkspace {
    /// Where changes from outside come from.
    pub(crate) fn take_changes_from(&mut self, incoming: Receiver<Prepared>) {
        self.change.incoming = Some(incoming);
    }
}

/// The next change from outside, once all of the scene's events have passed.
pub(super) fn next_from_outside(world: &World, state: &StepState, ws: &StepWorkspace) -> Option<Prepared> {
    let all_passed = state.phase >= world.changes().len() && state.outside.len() < world.changes_from_outside();
    ws.change.incoming.as_ref().filter(|_| all_passed)?.try_recv().ok()
}
