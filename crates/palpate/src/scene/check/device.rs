//! The range of every value of device, hand, coupling and limits.

use palpate_haptics::SetupError;
use palpate_haptics::limits::Limits;
use palpate_haptics::script::HandScript;

use super::super::description::SceneDescription;
use super::super::error::nearest;
use super::super::parse::Source;
use super::Checked;

/// Checks every value of device, hand, coupling and limits.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let known: Vec<_> = crate::devices::device_names().collect();
    named(source, "device.kind", &scene.device.kind, &known)?;
    let hands: Vec<_> = crate::devices::hand_names().collect();
    named(source, "hand.preset", &scene.hand.preset, &hands)?;
    let refused = |path: &str, e: SetupError| source.at(path, e.to_string(), "correct the value");
    let spec = crate::devices::spec(&scene.device).map_err(|e| refused("device.preset", e))?;
    scene.device.mechanics.validate().map_err(|e| refused("device.mechanics", e))?;
    if let Some(coupling) = &scene.coupling {
        coupling.validate().map_err(|e| refused("coupling", e))?;
    }
    Limits::new(&scene.limits, &spec).map_err(|e| refused("limits", e))?;
    HandScript::new(scene.hand.path.clone()).map_err(|e| {
        let entry = match e {
            SetupError::ScriptGap { entry, .. }
            | SetupError::ScriptOrder { entry, .. }
            | SetupError::ScriptNumber { entry, .. }
            | SetupError::ScriptSpeed { entry, .. } => format!("hand.path.{entry}"),
            _ => "hand.path".to_string(),
        };
        source.at(&entry, e.to_string(), "give strictly increasing times from 0 and positions in metres")
    })?;
    Ok(())
}

fn named(source: &Source<'_>, path: &str, name: &str, known: &[&str]) -> Checked {
    if known.contains(&name) {
        return Ok(());
    }
    let remedy = match nearest(name, known.iter().copied()) {
        Some(best) => format!("did you mean `{best}`?"),
        None => format!("known are {}", known.join(", ")),
    };
    Err(source.at(path, format!("there is no `{name}`"), remedy))
}
