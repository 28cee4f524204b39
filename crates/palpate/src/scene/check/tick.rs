//! What the tick takes from a step.

use super::super::description::{SceneDescription, TickDescription, TickMethod};
use super::super::parse::Source;
use super::Checked;
use super::number::not_negative;

/// Most nodes of a patch: its compliance, which the step makes and the tick reads, grows with their square.
const MOST_PATCH_NODES: usize = 512;

pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let tick = &scene.tick;
    if !(3..=MOST_PATCH_NODES).contains(&tick.patch_nodes) {
        let message = format!("patch_nodes = {} is not a number from 3 to {MOST_PATCH_NODES}", tick.patch_nodes);
        return Err(source.at("tick.patch_nodes", message, "use 48, or set method = \"frozen\" for no patch"));
    }
    not_negative(source, "tick.hand_over", tick.hand_over, "s")?;
    let default = TickDescription::default();
    for (key, differs) in
        [("patch_nodes", tick.patch_nodes != default.patch_nodes), ("hand_over", tick.hand_over != default.hand_over)]
    {
        if differs && tick.method == TickMethod::Frozen {
            let message = format!("`{key}` has no effect: the tick's rows are frozen");
            return Err(source.at(&format!("tick.{key}"), message, "remove it, or set method = \"local\""));
        }
    }
    Ok(())
}
