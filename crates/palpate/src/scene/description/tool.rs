//! A tool.

use palpate_collision::shape::ToolShape;
use serde::{Deserialize, Serialize};

/// A tool: a rigid shape whose pose comes from the device.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolDescription {
    /// Name in reports.
    pub name: String,
    /// Shape in the frame of the tool.
    pub shape: ToolShape,
}
