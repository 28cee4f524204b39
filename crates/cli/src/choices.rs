//! What a scene file may name, from the registers themselves.

use palpate::fem::material::Material;
use palpate::scene::{ContactLawKind, ContactMethod};
use palpate::solver::solver::Solver;

/// One line a key.
pub(crate) fn scene_choices() -> String {
    let join = |names: &mut dyn Iterator<Item = &'static str>| wrapped(&names.collect::<Vec<_>>());
    format!(
        "A scene file may name (examples/scenes/block.toml shows where):
  law of a material    {}
  [contact] law        {}
  [contact] method     {}
  [solver] kind        {}",
        join(&mut Material::NAMES.iter().copied()),
        join(&mut ContactLawKind::ALL.iter().map(|law| law.name())),
        join(&mut ContactMethod::ALL.iter().map(|method| method.name())),
        join(&mut Solver::NAMES.iter().copied()),
    )
}

/// Four names a line, under the first.
fn wrapped(names: &[&str]) -> String {
    let lines: Vec<_> = names.chunks(4).map(|names| names.join(", ")).collect();
    lines.join(",\n                       ")
}
