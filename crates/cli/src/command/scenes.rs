//! `palpate scenes`.

use miette::Result;
use palpate::scene::{BUNDLED_SCENES, Scene};

use crate::choices::scene_choices;
use crate::output::say;

pub(crate) fn scenes() -> Result<u8> {
    for bundled in BUNDLED_SCENES {
        let scene = Scene::bundled(bundled.name).map_err(super::report)?;
        say(format_args!("{:12} {}", bundled.name, scene.description().description))?;
    }
    say(format_args!("\n{}", scene_choices()))?;
    Ok(0)
}
