//! What a scene file may name, from the registers themselves.

use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::fem::material::Material;
use palpate::scene::{ContactLawKind, ContactMethod};
use palpate::solver::solver::Solver;

/// One line a key.
pub(crate) fn scene_choices() -> String {
    let join = |names: &mut dyn Iterator<Item = &'static str>| wrapped(&names.collect::<Vec<_>>());
    format!(
        "A scene file may name (examples/scenes/block.toml shows where):
  law of a material    {}
  [[body]] compliance  {}
  [[body]] correction  {}
  [[body]] accuracy    relative error of the contact forces to keep to, above 0
  [contact] law        {}
  [contact] method     {}
  [solver] kind        {}
  [[event]]            release, hold or remove (examples/scenes/cut.toml shows where)",
        join(&mut Material::NAMES.iter().copied()),
        join(&mut ComplianceMethod::ALL.iter().map(|method| method.name())),
        join(&mut MotionCorrection::ALL.iter().map(|correction| correction.name())),
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
