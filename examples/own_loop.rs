//! A program with its own loop: it moves the tool, one step at a time, and prints force against depth.

#![allow(clippy::print_stdout)]

use nalgebra::Isometry3;
use palpate::prelude::*;

/// Top of the bundled block and radius of its ball (m).
const SKIN: f64 = 0.03;
const RADIUS: f64 = 0.012;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let world = Scene::bundled("block")?.build()?;
    let mut simulation = Simulation::new(&world)?;
    println!("depth [mm]  force [N]  contacts");
    for millimetres in 0..=8 {
        let depth = 1e-3 * f64::from(millimetres);
        let tool = Isometry3::translation(0.0, 0.0, SKIN + RADIUS - depth);
        // A third of a second at each depth: the tissue comes to rest.
        let mut report = simulation.step(&tool);
        for _ in 1..10 {
            report = simulation.step(&tool);
        }
        println!("{:10.1}  {:9.4}  {:8}", 1e3 * depth, report.force.z, report.active);
    }
    Ok(())
}
