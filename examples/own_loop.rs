//! The tissue in a loop of one's own: a pose in, a force out, no device and no threads.

#![allow(clippy::print_stdout)]

use nalgebra::Isometry3;
use palpate::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let world = Scene::bundled("liver")?.build()?;
    let mut simulation = Simulation::new(&world)?;
    println!("depth mm   force N   contacts   CG iterations   residual");
    for step in 0..60 {
        let y = 0.012 + 0.0002 * f64::from(step); // m: the finger moves towards the back
        let report = simulation.step(&Isometry3::translation(0.105, y, 0.140));
        if step % 6 == 0 {
            println!(
                "{:8.2} {:9.4} {:10} {:15} {:10.1e}",
                1e3 * report.indentation,
                report.force.norm(),
                report.active,
                report.free_motion.iterations,
                report.solve.residual
            );
        }
    }
    Ok(())
}
