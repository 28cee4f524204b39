//! Which laws come back from what no tissue bears, by element and mesh size: the block of `tests/robustness.rs`.
//!
//! `cargo bench --bench robustness -- fine` prints the table for each kind of element on a finer mesh (2 to 8 minutes), without
//! `fine` that of the test's own mesh. `element=averaged`, `law=ogden` and `ordeal=Twisted` choose among them.

#![allow(clippy::print_stdout)] // the tables

#[path = "../tests/ordeals/mod.rs"]
mod ordeals;

use palpate::fem::element::ElementKind;
use palpate::fem::material::Material;

use ordeals::{ORDEALS, endure, mesh, world};

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
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
