//! A tool.

use palpate_collision::Tool;
use palpate_haptics::gripper::GripConfig;
use serde::{Deserialize, Serialize};

/// A tool: a shape, or several as one, whose pose comes from the device. Two groups of parts may be jaws, which the
/// device's gripper turns.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolDescription {
    /// Name in reports.
    pub name: String,
    /// Shape in the frame of the tool.
    pub shape: Tool,
    /// Coupling of the jaws and limits of their torque; for a shape with a `gripper` only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grip: Option<GripConfig>,
}
