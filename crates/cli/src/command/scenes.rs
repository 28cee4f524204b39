//! `palpate scenes`.

use std::process::ExitCode;

use miette::Result;
use palpate::scene::{BUNDLED_SCENES, Scene};

#[allow(clippy::print_stdout)]
pub(crate) fn scenes() -> Result<ExitCode> {
    for bundled in BUNDLED_SCENES {
        let scene = Scene::bundled(bundled.name).map_err(super::report)?;
        println!("{:12} {}", bundled.name, scene.description().description);
    }
    Ok(ExitCode::SUCCESS)
}
