//! The tool before the first step.

use nalgebra::{Isometry3, Translation3};
use palpate_collision::tool::ToolPose;
use palpate_haptics::script::HandScript;

use crate::scene::SceneDescription;

/// Where the tool is before the device has told.
pub(super) fn first(description: &SceneDescription) -> ToolPose {
    let first = HandScript::new(description.hand.path.clone()).ok().map(|script| script.intent(0.0));
    let (place, gripper) = match first {
        Some(first) => (Isometry3::from_parts(first.position.into(), first.rotation), first.gripper),
        None => (Isometry3::from(Translation3::from(description.device.origin)), 1.0),
    };
    let hinge = description.tools.first().and_then(|tool| tool.shape.hinge());
    ToolPose { frame: place, opening: hinge.map_or(0.0, |hinge| hinge.opening(gripper)) }
}
