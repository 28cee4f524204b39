//! Runs a bundled scene in virtual time and prints what the hand felt.

#![allow(clippy::print_stdout)]

use palpate::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = Scene::bundled("block")?; // or Scene::load("my_scene.toml".as_ref())
    let world = scene.build()?; // mesh, body, symbolic factorisation
    let options = RunOptions { length: Length::Seconds(2.0), lockstep: true, ..RunOptions::default() };
    let summary = run(&world, &options, &AtomicBool::new(false), &mut Unobserved)?.summary;
    println!("{} steps, {} ticks, {}", summary.steps, summary.ticks, summary.end);
    println!("largest force {:.3} N", summary.largest_force);
    println!("worst complementarity residual {:.1e}", summary.worst_residual);
    Ok(())
}
