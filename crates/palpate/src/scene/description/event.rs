//! What happens to the soft body while it runs.

use serde::{Deserialize, Serialize};

use super::NodeSelection;

/// A change of the soft body at a moment of the run: nodes released, nodes held, elements removed, in this order. Places
/// are those of the mesh, whatever shape the body has by then.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventDescription {
    /// When (s): in the first step that begins then or later.
    pub time: f64,
    /// Nodes that are free from now on, of those that are fixed or held: a clamp that opens.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub release: Option<NodeSelection>,
    /// Nodes that stay where they are from now on: a clamp that closes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<NodeSelection>,
    /// Elements that are gone from now on, with their mass: a cut. An element is in a plane, box or ball where the mean of
    /// its corners is, in a region where it belongs to it, and in a node set where all its corners are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remove: Option<NodeSelection>,
}
