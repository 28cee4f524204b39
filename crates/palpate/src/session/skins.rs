//! The triangles of the soft body's surface in each phase of a run: before its first event, and after each event or change.

use std::sync::{Arc, Mutex, PoisonError};

use palpate_trace::Skin;

use super::Session;
use crate::world::{Change, World};

impl Session {
    /// Triangles of the soft body's surface, by the phase of a shape.
    pub fn skins(&self) -> Arc<Skins> {
        Arc::clone(&self.skins)
    }
}

/// Skins by phase ([`Shape::phase`](super::Shape)). Events are known from the start, changes from outside since they
/// were made.
#[derive(Debug)]
pub struct Skins {
    by_phase: Mutex<Vec<Skin>>,
}

impl Skins {
    pub(crate) fn new(world: &World) -> Arc<Self> {
        let whole: Skin = world.surface().triangles.as_slice().into();
        let after = world.changes().iter().map(|change| Arc::clone(change.triangles()));
        Arc::new(Self { by_phase: Mutex::new(std::iter::once(whole).chain(after).collect()) })
    }

    /// Three nodes of each triangle, counted from 0, counter-clockwise from outside; `None` for a phase that was not made.
    pub fn of(&self, phase: usize) -> Option<Skin> {
        self.by_phase.lock().unwrap_or_else(PoisonError::into_inner).get(phase).cloned()
    }

    /// Phases that were made, the first one too.
    pub fn phases(&self) -> usize {
        self.by_phase.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// Before a step can take the change, so that whoever sees its phase finds its skin.
    pub(crate) fn push(&self, change: &Change) {
        self.by_phase.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::clone(change.triangles()));
    }
}
