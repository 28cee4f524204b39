//! The range of every value of a scene.

mod body;
mod contact;
mod device;
mod event;
mod number;
mod rates;
mod solid;
mod tick;
mod tool;

use super::description::SceneDescription;
use super::error::SceneError;
use super::parse::Source;
use number::{finite, positive};

pub(crate) use body::MOST_SUBSTEPS;
pub(crate) use rates::{Staleness, staleness};

type Checked = Result<(), SceneError>;

/// Checks every value; the first that is out of range is the error.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    if scene.name.is_empty() || scene.name.contains(['/', '\\']) {
        return Err(source.at(
            "name",
            format!("`{}` cannot be part of a file name", scene.name),
            "use letters, digits, `-` and `_`",
        ));
    }
    positive(source, "seconds", scene.seconds, "s")?;
    finite(source, "gravity", &scene.gravity)?;
    rates::check(scene, source)?;
    match scene.bodies.as_slice() {
        [body] => body::check(body, source)?,
        [] => return Err(source.at("body", "there is no body", "add a [[body]] with a mesh and a material")),
        more => {
            let message = format!("{} bodies, but this version simulates one", more.len());
            return Err(source.at("body", message, "keep one [[body]]; regions carry different materials"));
        }
    }
    match scene.tools.as_slice() {
        [tool] => tool::check(tool, source)?,
        [] => return Err(source.at("tool", "there is no tool", "add a [[tool]] with a shape")),
        more => {
            let message = format!("{} tools, but this version moves one", more.len());
            return Err(source.at("tool", message, "keep one [[tool]]"));
        }
    }
    solid::check(scene, source)?;
    contact::check(scene, source)?;
    event::check(scene, source)?;
    tick::check(scene, source)?;
    device::check(scene, source)
}
