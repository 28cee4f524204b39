//! `palpate check`.

use miette::Result;
use palpate::scene::Scene;

use crate::output::say;

pub(crate) fn check(scene: &str) -> Result<u8> {
    let world = Scene::open(scene).map_err(super::report)?.build().map_err(super::report)?;
    say(world.understood())?;
    world.warnings().iter().try_for_each(|warning| say(format_args!("warning: {warning}")))?;
    Ok(0)
}
