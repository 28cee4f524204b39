//! The haptic loop: the stiffest wall that a device renders, the couplings that hold in each scene, and the error of the force
//! against the scene computed offline at 1 kHz.

mod accuracy;
mod cases;
mod grasp;
mod palpation;
mod scenes;
mod wall;
mod width;

use miette::Result;

use super::plot::Layout;
use super::{Chart, Settings, Work};

/// Measures everything that `palpate chart haptics` shows.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<Chart> {
    let (mut tables, mut panels) = wall::measure(settings, work)?;
    let (couplings, of_couplings) = width::measure(settings, work)?;
    let (force, of_force) = accuracy::measure(settings, work)?;
    let (grasp, of_grasp) = grasp::measure(settings, work)?;
    tables.extend([couplings, force]);
    panels.extend(of_couplings.into_iter().chain(of_force).chain(of_grasp));
    let mut notes = vec![
        "walls: m = 0.1 kg; friction 0.06 N and an encoder of 30 µm hold up to 2 f/step = 4000 N/m still by themselves".into(),
        "couplings: the virtual device (0.1 kg, 0.2 N s/m, 0.06 N, 30 µm, one tick of delay) presses as the scene's path does \
         and is at rest where it stays within 0.1 mm of an even motion over the last 0.4 s of 1.6 s"
            .into(),
    ];
    if !settings.quick {
        tables.push(grasp);
    }
    if settings.quick {
        notes.push(
            "quick: the block has 4 x 4 x 3 cells, its path ends after the press; no liver, no cut, no grasp, no 100 Hz".into(),
        );
    } else {
        notes.push("force: the liver has cells of 25 mm along its path, and its own or 12 mm where it is touched; it moves twice as fast".into());
    }
    if work.stopped() {
        notes.push("ended early: what was measured until then".into());
    }
    let title = "The haptic loop: stable walls, stable couplings, error of the force";
    Ok(Chart { title: title.into(), panels, layout: Layout::columns(3), tables, notes })
}
