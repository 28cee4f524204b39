//! `palpate equilibrium`, and what the program says of integrators.

use crate::program_runs::{NODES, Place, SCENE};
use palpate::fem::format;
use serde_json::Value;

fn heavy() -> Place {
    Place::with(&SCENE.replace("gravity = [0, 0, 0]", "gravity = [0, 0, -9.81]"))
}

#[test]
fn equilibrium_prints_a_reaction_that_carries_the_weight_and_writes_the_state() {
    let place = heavy();
    let run = place.run("equilibrium scene.toml --final state.vtu --json");
    assert_eq!(run.code, Some(0), "{run:?}");
    let report: Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!(report["converged"], true);
    let number = |name: &str, c: usize| report[name][c].as_f64().unwrap();
    // 6 x 6 x 3 cm of 1060 kg/m³.
    let weight = 1060.0 * 0.06 * 0.06 * 0.03 * 9.81;
    assert!((number("weight", 2) + weight).abs() < 1e-9 && (number("reaction", 2) - weight).abs() < 1e-7, "{report}");
    assert!(report["relative_residual"].as_f64().unwrap() <= 1e-9);
    let mesh = format::read(&place.path("state.vtu")).unwrap().mesh;
    let top = mesh.nodes.iter().map(|x| x.z).fold(0.0, f64::max);
    assert!(mesh.nodes.len() == NODES && top < 0.03, "it sags: {top}");

    let text = place.run("equilibrium scene.toml");
    for word in ["in equilibrium", "load steps", "Newton iterations", "residual", "reaction", "weight"] {
        assert!(text.out.contains(word), "{word}: {}", text.out);
    }
}

#[test]
fn a_body_that_nothing_holds_and_a_state_that_is_not_vtu_are_refused() {
    let place = Place::with(&SCENE.replace("fixed = [{ node_set = \"z_min\" }]", ""));
    let run = place.run("equilibrium scene.toml");
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.err.contains("no node is fixed") && run.err.contains("fixed = [...]"), "{}", run.err);
    let run = heavy().run("equilibrium scene.toml --final state.stl");
    assert!(run.code == Some(2) && run.err.contains("VTU"), "{run:?}");
}

#[test]
fn check_and_run_print_the_integrator_and_the_critical_step() {
    let explicit = SCENE.replace("density = 1060", "density = 1060\nintegrator = \"explicit\"");
    let place = Place::with(&explicit.replace("rayleigh_stiffness = 0.005", "rayleigh_stiffness = 0.0005"));
    let check = place.run("check scene.toml");
    assert_eq!(check.code, Some(0), "{check:?}");
    assert!(check.out.contains("explicit") && check.out.contains("critical step"), "{}", check.out);
    let run = place.run("run scene.toml --lockstep --no-trace --steps 10");
    assert!(run.code == Some(0) && run.out.contains("critical step"), "{run:?}");

    let few = explicit.replace("\"explicit\"", "\"explicit\"\nexplicit = { substeps = 2 }");
    let refused = Place::with(&few).run("check scene.toml");
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("critical") && refused.err.contains("substeps"), "{}", refused.err);
}

#[test]
fn a_run_by_any_integrator_replays_to_the_bit() {
    for integrator in ["newton", "explicit"] {
        let text = SCENE.replace("rayleigh_stiffness = 0.005", &format!("integrator = \"{integrator}\""));
        let place = Place::with(&text);
        let run = place.run("run scene.toml --lockstep --seconds 0.5");
        assert_eq!(run.code, Some(0), "{run:?}");
        let replay = place.run("replay small.mcap");
        assert!(replay.code == Some(0) && replay.out.contains("the same to the bit"), "{integrator}: {replay:?}");
    }
}
