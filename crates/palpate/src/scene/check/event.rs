//! The range of every value of the events, and what else a scene with events may not have.

use palpate_fem::element::ElementKind;

use super::super::description::{IntegratorKind, SceneDescription};
use super::super::parse::Source;
use super::Checked;
use super::body::selection;
use super::number::not_negative;

/// Most changes from outside: each keeps its own body in memory.
const MOST_CHANGES: u32 = 1000;

/// Checks every value of the events.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    for (k, event) in scene.events.iter().enumerate() {
        let path = |key: &str| format!("event.{k}.{key}");
        not_negative(source, &path("time"), event.time, "s")?;
        let parts = [("release", &event.release), ("hold", &event.hold), ("remove", &event.remove)];
        if parts.iter().all(|(_, part)| part.is_none()) {
            let remedy = "add `release`, `hold` or `remove` with a selection, such as { node_set = \"x_min\" }";
            return Err(source.at(&format!("event.{k}"), "the event changes nothing", remedy));
        }
        for (key, part) in parts {
            part.iter().try_for_each(|part| selection(source, &path(key), part))?;
        }
    }
    if let Some(k) = scene.bodies.iter().position(|body| body.changes > MOST_CHANGES) {
        let message = format!("{} changes in one run", scene.bodies[k].changes);
        return Err(source.at(&format!("body.{k}.changes"), message, format!("use at most {MOST_CHANGES}")));
    }
    let changes = !scene.events.is_empty() || scene.bodies.iter().any(|body| body.changes > 0);
    if changes { methods(scene, source) } else { Ok(()) }
}

/// The methods that a change of the body goes with.
fn methods(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let refuse = |path: &str, method: String, remedy: &str| {
        let message = format!("{method} does not go with [[event]] or `changes`: the body changes while it runs");
        Err(source.at(path, message, format!("{remedy}, or remove the events and `changes`")))
    };
    for (k, body) in scene.bodies.iter().enumerate() {
        if body.integrator != IntegratorKind::BackwardEuler {
            let method = format!("integrator `{}`", body.integrator.name());
            return refuse(&format!("body.{k}.integrator"), method, "set integrator = \"backward_euler\"");
        }
        if body.element == ElementKind::Averaged {
            let method = format!("element `{}`", body.element.name());
            return refuse(&format!("body.{k}.element"), method, "set element = \"quadratic\" or \"linear\"");
        }
    }
    Ok(())
}
