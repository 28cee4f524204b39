//! A hand presses the bundled liver: the whole of Palpate in fifteen lines.

#![allow(clippy::print_stdout)]

use palpate::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scene = Scene::bundled("liver")?;
    scene.edit(|s| s.contact.friction = 0.2)?; // every value of the scene file
    let world = scene.build()?; // mesh, pattern, symbolic factorisation
    let options = RunOptions { length: Length::Seconds(2.5), lockstep: true, ..RunOptions::default() };
    let outcome = run(&world, &options, &AtomicBool::new(false), &mut Unobserved)?;
    let s = &outcome.summary;
    println!("{} steps, {} ticks, largest force {:.3} N", s.steps, s.ticks, s.largest_force);
    println!("worst residual {:.1e}, largest jump {:.4} N", s.worst_residual, s.largest_jump);
    Ok(())
}
