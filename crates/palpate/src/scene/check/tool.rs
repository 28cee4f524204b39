//! The range of every value of a tool. Its shape is valid by construction.

use super::super::description::ToolDescription;
use super::super::parse::Source;
use super::Checked;

pub(super) fn check(tool: &ToolDescription, source: &Source<'_>) -> Checked {
    let Some(grip) = &tool.grip else { return Ok(()) };
    if tool.shape.hinge().is_none() {
        let message = "`grip` has no effect on a tool without jaws";
        return Err(source.at(
            "tool.0.grip",
            message,
            "leave it out, or give the shape a `gripper` and parts with `jaw`",
        ));
    }
    grip.validate().map_err(|e| source.at("tool.0.grip", e.to_string(), "correct the value"))
}
