//! What the tick takes from a step.

use palpate_haptics::tick::PatchTickConfig;
use serde::{Deserialize, Serialize};

/// What contact problem a tick solves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TickMethod {
    /// Contacts found anew in each tick, on the tissue around the tool as the step left it.
    #[default]
    Local,
    /// The rows of the step: contacts, normals and forms stay as they were until the next one. For comparison.
    Frozen,
}

/// What the tick takes from a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TickDescription {
    /// What contact problem a tick solves.
    pub method: TickMethod,
    /// Largest number of nodes of the tissue around the tool; the nearest triangles are kept. For `method = "local"` only.
    pub patch_nodes: usize,
    /// Time (s) over which the shape of the tissue goes over from one step's to the next's, a third of a step at most; 0 lets the force
    /// jump. For `method = "local"` only.
    pub hand_over: f64,
}

impl Default for TickDescription {
    fn default() -> Self {
        Self {
            method: TickMethod::default(),
            patch_nodes: PatchTickConfig::MAX_NODES,
            hand_over: PatchTickConfig::HAND_OVER,
        }
    }
}
