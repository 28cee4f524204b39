//! Changes of a body in a run: as they happened, and the way of those from outside to the step that takes them and into the
//! trace.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::sync::mpsc::{SyncSender, sync_channel};

use palpate_trace::{MetadataTrace, Trace};
use serde::Serialize;

use crate::counted::counted;
use crate::step::{FactorFit, Prepared, StepWorkspace};
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
    /// Where the trace learns of them, with the number of those that it knows.
    line: Option<(MetadataTrace, usize)>,
}

impl ChangeQueue {
    /// A queue with room for all changes that the scene allows, to the steps with this workspace.
    pub(crate) fn new(world: &World, ws: &mut StepWorkspace) -> Self {
        let (sender, receiver) = sync_channel(world.changes_from_outside());
        ws.take_changes_from(receiver);
        Self { maker: ChangeMaker::new(world), sender, line: None }
    }

    /// From now on the trace is told of every change, on the thread that asks for it and before a step can take it.
    pub(crate) fn trace(&mut self, line: MetadataTrace) {
        self.line = Some((line, 0));
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
        if let Some((line, told)) = &mut self.line {
            *told += 1;
            // Selections were read from TOML or could have been.
            let text = toml::to_string(request).unwrap_or_default();
            line.put(&record_name(*told), BTreeMap::from([(REQUEST.into(), text)]));
        }
        // There is room for as many as the maker makes; only a step that is gone takes none.
        self.sender.try_send(Prepared::new(change)).map_err(|_| ChangeError::NotRunning)?;
        Ok(text)
    }
}

/// Name of the metadata record of a trace for the `number`th change from outside, from 1, and its entry for what was asked
/// for, as TOML.
fn record_name(number: usize) -> String {
    format!("change {number}")
}
const REQUEST: &str = "request";

/// The changes that a trace tells of, in order, up to the first that is missing or cannot be read.
pub(crate) fn requests(trace: &Trace) -> VecDeque<ChangeRequest> {
    let record = |number| trace.metadata.get(&record_name(number))?.get(REQUEST);
    (1..).map_while(|number| toml::from_str(record(number)?).ok()).collect()
}
