//! Changes of a body in a run: as they happened, and the way of those from outside to the step that takes them and into the
//! trace.

use std::fmt;
use std::sync::mpsc::{SyncSender, sync_channel};

use serde::{Deserialize, Serialize};

use crate::counted::counted;
use crate::step::{FactorFit, Prepared, StepState, StepWorkspace};
use crate::world::{Change, ChangeError, ChangeMaker, ChangeRequest, World};

/// An event as it happened.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventRecord {
    /// Begin of the first step after it (s).
    pub time: f64,
    /// What happened, in words.
    pub event: String,
    /// How the latest factor served the changed body in that step.
    pub factor: FactorFit,
    /// Nodes whose rows of the matrix changed since that factor, where that was worked out.
    pub touched: u32,
    /// Conjugate-gradient iterations of that step.
    pub iterations: usize,
}

impl fmt::Display for EventRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s: {}; ", self.time, self.event)?;
        match self.factor {
            FactorFit::Own => write!(f, "factored in the step"),
            FactorFit::Updated => write!(f, "factor updated in {}", counted(self.touched, "node", "nodes")),
            FactorFit::Renewed => write!(f, "the factor could not follow, factored anew in the step"),
            FactorFit::Outdated => {
                write!(f, "the factor could not follow and the step's own matrix could not be factored: no contact")
            }
        }?;
        write!(f, ", {}", counted(self.iterations, "iteration", "iterations"))
    }
}

/// The end of whoever asks for changes. The other is in a step's workspace: each step takes what has come by its begin.
pub(crate) struct ChangeQueue {
    maker: ChangeMaker,
    sender: SyncSender<Prepared>,
}

impl ChangeQueue {
    /// A queue with room for all changes that the scene allows, to the steps with this workspace.
    pub(crate) fn new(world: &World, ws: &mut StepWorkspace) -> Self {
        let (sender, receiver) = sync_channel(world.changes_from_outside());
        ws.take_changes_from(receiver);
        Self { maker: ChangeMaker::new(world), sender }
    }

    /// Makes the changed body on this thread, shows it to `made` and sends it; what happens, in words. Takes the time
    /// of building a body: some ten milliseconds per thousand nodes.
    pub(crate) fn change(
        &mut self,
        world: &World,
        request: &ChangeRequest,
        made: impl FnOnce(&Change),
    ) -> Result<String, ChangeError> {
        let change = self.maker.make(world, request)?;
        made(&change);
        let text = change.text().to_string();
        // There is room for as many as the maker makes; only a step that is gone takes none.
        self.sender.try_send(Prepared::new(change)).map_err(|_| ChangeError::NotRunning)?;
        Ok(text)
    }
}

/// A change from outside as it was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TakenChange {
    /// The first step with the changed body.
    pub step: u64,
    /// What was asked for.
    pub request: ChangeRequest,
}

/// All changes of a run as a trace keeps them, in TOML.
#[derive(Default, Serialize, Deserialize)]
struct TakenChanges {
    #[serde(default)]
    change: Vec<TakenChange>,
}

/// The changes that a run has taken.
pub(crate) fn taken(world: &World, state: &StepState) -> Vec<TakenChange> {
    let all = state.outside(world);
    all.filter_map(|(step, change)| Some(TakenChange { step, request: change.request()?.clone() })).collect()
}

/// As text for a trace; empty without changes.
pub(crate) fn to_text(changes: &[TakenChange]) -> String {
    if changes.is_empty() {
        return String::new();
    }
    // Selections were read from TOML or could have been.
    toml::to_string(&TakenChanges { change: changes.to_vec() }).unwrap_or_default()
}

/// From the text of a trace; `None` where it cannot be read.
pub(crate) fn from_text(text: &str) -> Option<Vec<TakenChange>> {
    toml::from_str::<TakenChanges>(text).ok().map(|changes| changes.change)
}
