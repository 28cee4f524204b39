//! The range of every value of device, hand, coupling, passivity and limits.

use palpate_devices::place::Place;
use palpate_haptics::SetupError;
use palpate_haptics::limits::Limits;
use palpate_haptics::passivity::Passivity;
use palpate_haptics::script::HandScript;

use super::super::description::SceneDescription;
use super::super::error::nearest;
use super::super::parse::Source;
use super::Checked;
use super::number::positive;

/// Checks every value of device, hand, coupling and limits.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let known: Vec<_> = crate::devices::device_names().collect();
    named(source, "device.kind", &scene.device.kind, &known)?;
    let hands: Vec<_> = crate::devices::hand_names().collect();
    named(source, "hand.preset", &scene.hand.preset, &hands)?;
    let refused = |path: &str, e: SetupError| source.at(path, e.to_string(), "correct the value");
    if scene.device.preset.is_some() && scene.device.record.is_some() {
        let message = "there is a `preset` and a `record`".to_string();
        return Err(source.at("device.record", message, "keep the one that describes the device"));
    }
    let record = if scene.device.record.is_some() { "device.record" } else { "device.preset" };
    let spec = crate::devices::spec(&scene.device, None).map_err(|e| refused(record, e))?;
    if let Some(key) = crate::devices::keys_without_effect(&scene.device).next() {
        let message = format!("`{key}` has no effect on a device of kind `{}`", scene.device.kind);
        return Err(source.at(&format!("device.{key}"), message, "leave it out, or change the kind"));
    }
    if let Some(range) = scene.device.gripper_range {
        positive(source, "device.gripper_range", range, "m")?;
    }
    Place::new(&scene.device.place()).map_err(|e| refused("device", e))?;
    scene.device.mechanics.validate().map_err(|e| refused("device.mechanics", e))?;
    if let Some(coupling) = &scene.coupling {
        coupling.validate().map_err(|e| refused("coupling", e))?;
    }
    let period = 1.0 / scene.rates.tick;
    Passivity::new(&scene.passivity, &spec, period).map_err(|e| refused("passivity", e))?;
    Limits::new(&scene.limits, &spec).map_err(|e| refused("limits", e))?;
    if scene.hand.path.is_empty() && !crate::devices::follows_path(&scene.device.kind) {
        return Ok(());
    }
    HandScript::new(scene.hand.path.clone()).map_err(|e| {
        let remedy = match e {
            SetupError::ScriptSpeed { .. } => {
                "give positions in metres and times in seconds, with entries between far places"
            }
            _ => "give strictly increasing times from 0 and positions in metres",
        };
        let entry = match e {
            SetupError::ScriptGap { entry, .. }
            | SetupError::ScriptOrder { entry, .. }
            | SetupError::ScriptNumber { entry, .. }
            | SetupError::ScriptRotation { entry }
            | SetupError::ScriptGripper { entry, .. }
            | SetupError::ScriptSpeed { entry, .. } => format!("hand.path.{entry}"),
            _ => "hand.path".to_string(),
        };
        source.at(&entry, e.to_string(), remedy)
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
