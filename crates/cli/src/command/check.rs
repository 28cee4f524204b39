//! `palpate check`.

use std::process::ExitCode;

use miette::Result;
use palpate::scene::Scene;

#[allow(clippy::print_stdout)]
pub(crate) fn check(scene: &str) -> Result<ExitCode> {
    let world = Scene::open(scene).map_err(super::report)?.build().map_err(super::report)?;
    println!("{}", world.understood());
    for warning in world.warnings() {
        println!("warning: {warning}");
    }
    Ok(ExitCode::SUCCESS)
}
