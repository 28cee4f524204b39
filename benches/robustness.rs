//! Which laws come back from what no tissue bears, by element and mesh size: the block of `tests/tissue/robustness.rs`.
//!
//! `cargo bench --bench robustness -- fine` prints the table for each kind of element on a finer mesh (2 to 8 minutes), without
//! `fine` that of the test's own mesh. `element=averaged`, `law=ogden` and `ordeal=Twisted` choose among them. With `-- liver`
//! the bundled liver begins mirrored, flat or wound up instead (a minute).

#![allow(clippy::print_stdout)] // the tables

#[path = "../tests/ordeals/mod.rs"]
mod ordeals;

use nalgebra::{Isometry3, Rotation3, Vector3};
use palpate::fem::element::ElementKind;
use palpate::fem::material::Material;
use palpate::prelude::*;
use palpate::step::StepReport;

use ordeals::{ORDEALS, endure, mesh, world};

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if words.iter().any(|word| word == "liver") {
        return livers();
    }
    let fine = words.iter().any(|word| word == "fine");
    // `key=name` chooses among the names of a key; a key without choices takes all.
    let asks_for = |key: &str, name: &str| {
        let mut chosen = words.iter().filter_map(|word| word.strip_prefix(key)?.strip_prefix('=')).peekable();
        chosen.peek().is_none() || chosen.any(|choice| choice == name)
    };
    let folder = tempfile::tempdir().expect("a folder for the mesh");
    mesh(folder.path(), if fine { 4 } else { 2 });
    let names = ORDEALS.map(|ordeal| format!("{ordeal:?}"));
    for kind in ElementKind::ALL.into_iter().filter(|kind| asks_for("element", kind.name())) {
        let (mut cases, mut recovered, mut led, mut named, mut rolled_back) = (0, 0, 0, 0, 0);
        for law in Material::NAMES.iter().filter(|law| asks_for("law", law)) {
            for ratio in [1.0, 1e4] {
                // The laws without a bulk term have no averaged elements.
                let Ok(world) = world(folder.path(), law, kind, ratio, true) else { continue };
                for (ordeal, name) in ORDEALS.into_iter().zip(&names).filter(|(_, name)| asks_for("ordeal", name)) {
                    let outcome = endure(&world, ordeal);
                    cases += 1;
                    recovered += u32::from(outcome.recovers());
                    led += u32::from(outcome.led > 0);
                    named += u32::from(!outcome.recovers() && outcome.named > 0);
                    rolled_back += u32::from(outcome.rolled_back > 0);
                    if !outcome.recovers() || outcome.rolled_back > 0 || outcome.led > 0 {
                        println!("{law}, {}, {ratio:e}, {name}: {}", kind.name(), outcome.text());
                    }
                }
            }
        }
        println!(
            "{}: {recovered} of {cases} recover, {named} of the others are named to the end; {led} were led, in {rolled_back} steps were \
             rolled back",
            kind.name()
        );
    }
}

/// The bundled liver, its free nodes mirrored, in one plane, or wound up by a full turn about the vertical, and let go for
/// eight seconds.
fn livers() {
    for law in ["neo_hookean", "mooney_rivlin", "veronda_westmann"] {
        let mut scene = Scene::bundled("liver").expect("a bundled scene");
        let tissue = Material::from_young_poisson(law, 5e3, 0.45).expect("a registered law");
        scene.edit(|d| d.bodies[0].material = tissue.into()).expect("a sound change");
        let world = scene.build().expect("a sound scene");
        let rest = &world.mesh().nodes;
        let (low, high) = rest.iter().fold((rest[0], rest[0]), |(low, high), x| (low.inf(x), high.sup(x)));
        let middle = (low + high) * 0.5;
        for begun in ["mirrored", "flat", "wound up"] {
            let place = |x: &Vector3<f64>| match begun {
                "mirrored" => Vector3::new(x.x, x.y, 2.0 * middle.z - x.z),
                "flat" => Vector3::new(x.x, x.y, middle.z),
                _ => {
                    let angle = std::f64::consts::TAU * (x.z - low.z) / (high.z - low.z);
                    middle + Rotation3::from_axis_angle(&Vector3::z_axis(), angle) * (x - middle)
                }
            };
            let mut simulation = Simulation::new(&world).expect("positive definite at rest");
            for &node in world.model().node_of_free() {
                simulation.state_mut().fem.q[node as usize] = place(&rest[node as usize]);
            }
            let reports: Vec<_> = (0..240).map(|_| simulation.step(&Isometry3::translation(1.0, 1.0, 1.0))).collect();
            let count = |of: &dyn Fn(&&StepReport) -> bool| reports.iter().filter(of).count();
            let last = reports.iter().rposition(|r| r.tangle.is_some()).map_or(0, |step| step + 1);
            let astray = simulation.positions().iter().zip(rest).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max);
            println!(
                "{law}, {begun}: tangled for {last} steps, {} led, {} rolled back, {:.3} mm astray after {}",
                count(&|r| r.led),
                count(&|r| r.failed.is_some()),
                1e3 * astray,
                reports.len()
            );
        }
    }
}
