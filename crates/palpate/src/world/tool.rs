//! The tool before the first step.

use nalgebra::{Isometry3, Translation3};
use palpate_collision::contact::ContactSet;
use palpate_collision::detection::{DetectionWorkspace, detect_tool};
use palpate_collision::tool::ToolPose;
use palpate_haptics::script::HandScript;

use super::World;
use crate::scene::{SceneDescription, SceneError};

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

/// Refuses a tool that begins inside the body: there is no skin that it came through. Where a real hand begins is its
/// own affair.
pub(super) fn outside(world: &World) -> Result<(), SceneError> {
    if world.description().hand.path.is_empty() {
        return Ok(());
    }
    let mut ws = DetectionWorkspace::new(&world.geometry);
    let mut contacts = ContactSet::with_capacity(world.detection.max_contacts);
    let pose = world.first_tool();
    let report =
        detect_tool(&world.geometry, &world.mesh.nodes, world.tool(), &pose, &world.detection, &mut ws, &mut contacts);
    if report.tool_inside {
        let p = pose.frame.translation.vector;
        let message = format!("the tool begins inside the body, at {:.4}, {:.4}, {:.4} m", p.x, p.y, p.z);
        return Err(world.scene.at("hand.path.0", message, "begin outside the skin, then press"));
    }
    Ok(())
}
