//! Bodies that changes asked for from outside lead to while a run lasts, prepared by whoever asks, on its own thread.
//!
//! A run passes to such a body as it does to that of an event. Every one is made from the one before it, beginning with the
//! body after the scene's last event: until that has happened, changes from outside wait.

use std::sync::Arc;

use palpate_fem::model::FemConfig;
use serde::{Deserialize, Serialize};

use super::World;
use super::change::{Change, body_after, change_to};
use super::course::{Selections, Stretch, advance};
use crate::scene::{NodeSelection, SceneError};

/// A change of the soft body, as an `[[event]]` has one: nodes released, nodes held, elements removed, in this order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChangeRequest {
    /// Nodes that are free from now on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub release: Option<NodeSelection>,
    /// Nodes that stay where they are from now on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<NodeSelection>,
    /// Elements that are gone from now on, with their mass.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remove: Option<NodeSelection>,
}

impl ChangeRequest {
    /// From TOML text with the keys of an `[[event]]`, without its time.
    ///
    /// # Errors
    /// What is wrong with the text, with its place.
    pub fn from_toml(text: &str) -> Result<Self, ChangeError> {
        toml::from_str(text).map_err(|e| ChangeError::Text(e.to_string()))
    }
}

/// Why a change was not taken.
#[derive(Debug, thiserror::Error)]
pub enum ChangeError {
    /// The scene makes no room for changes.
    #[error("the scene has no room for changes from outside: give its body `changes = 8`, or as many as a run may see")]
    NoRoom,
    /// As many as the scene has room for have been made.
    #[error("the {capacity} changes that the scene has room for have been made: give its body a greater `changes`")]
    Full {
        /// The scene's `changes`.
        capacity: usize,
    },
    /// It names neither nodes nor elements.
    #[error("the change changes nothing: name what to `release`, `hold` or `remove`")]
    Empty,
    /// Its text cannot be read.
    #[error("the change cannot be read: {0}; it has the keys of an [[event]] without `time`")]
    Text(String),
    /// Nothing runs that could take it.
    #[error("the session does not run: start it before it is changed")]
    NotRunning,
    /// Its selections do not fit the body.
    #[error(transparent)]
    Selection(#[from] SceneError),
}

/// What bodies are made from, kept with the world of a scene that has room for changes.
#[derive(Clone, Debug)]
pub(super) struct Basis {
    /// That of the whole body, whose fixed nodes nothing releases.
    pub(super) config: FemConfig,
    /// What the scene's own events leave.
    pub(super) last: Stretch,
}

/// Makes one body after another.
pub(crate) struct ChangeMaker {
    held: Vec<bool>,
    gone: Vec<bool>,
    last: Option<Arc<Change>>,
    made: usize,
}

impl ChangeMaker {
    /// From the body after the scene's last event on.
    pub(crate) fn new(world: &World) -> Self {
        let (mut held, mut gone) = (Vec::new(), Vec::new());
        if let Some(basis) = &world.basis {
            held.clone_from(&basis.last.held);
            gone = vec![true; world.mesh.tetrahedra.len()];
            basis.last.left.iter().for_each(|&t| gone[t as usize] = false);
        }
        Self { held, gone, last: None, made: 0 }
    }

    /// The next body, for the world that the maker was made for. What it refuses leaves it as it was.
    pub(crate) fn make(&mut self, world: &World, request: &ChangeRequest) -> Result<Arc<Change>, ChangeError> {
        let Some(basis) = &world.basis else { return Err(ChangeError::NoRoom) };
        let capacity = world.changes_from_outside();
        if self.made >= capacity {
            return Err(ChangeError::Full { capacity });
        }
        let parts = Selections { release: &request.release, hold: &request.hold, remove: &request.remove };
        if parts.is_empty() {
            return Err(ChangeError::Empty);
        }
        let (mut held, mut gone) = (self.held.clone(), self.gone.clone());
        let number = world.changes.len() + self.made;
        let stretch = advance(&world.scene, &world.mesh, "change", &parts, &mut held, &mut gone)?;
        let stretch = Stretch { event: number, ..stretch };
        let later = body_after(world, &basis.config, stretch)?;
        let before = self.last.as_deref().or(world.changes.last());
        let change = Arc::new(change_to(world, before, later)?);
        (self.held, self.gone, self.last) = (held, gone, Some(Arc::clone(&change)));
        self.made += 1;
        Ok(change)
    }
}
