//! `palpate equilibrium`.

use miette::{IntoDiagnostic, Report, Result, miette};
use palpate::export::write_state;
use palpate::fem::integrator::equilibrium::EquilibriumReport;
use palpate::scene::Scene;
use palpate::settle::at_rest;
use serde_json::json;

use crate::arguments::EquilibriumArguments;
use crate::exit;
use crate::output::{check_kept, check_writable, say, scene_files};

pub(crate) fn equilibrium(arguments: &EquilibriumArguments) -> Result<u8> {
    let scene = Scene::open(&arguments.scene).map_err(super::report)?;
    if let Some(path) = &arguments.final_state {
        if path.extension().is_none_or(|e| e != "vtu") {
            return Err(miette!(help = "name it FILE.vtu", "--final {}: only VTU is written", path.display()));
        }
        check_kept("--final", path, &scene_files(&arguments.scene, &scene))?;
        check_writable("--final", path)?;
    }
    let world = scene.build().map_err(super::report)?;
    world.warnings().iter().for_each(|warning| eprintln!("warning: {warning}"));
    let (state, report) = at_rest(&world)
        .map_err(|e| miette!(help = "hold the body with `fixed = [...]`", "{}: {e}", arguments.scene))?;
    let moved = state.q.iter().zip(&world.mesh().nodes).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max);
    let mass = world.model().mass().iter().sum::<f64>();
    let weight = world.description().gravity.map(|g| g * mass);
    if arguments.json {
        say(serde_json::to_string_pretty(&as_json(&report, moved, &weight)).into_diagnostic()?)?;
    } else {
        say(as_text(world.scene().name(), &report, moved, &weight))?;
    }
    if let Some(path) = &arguments.final_state {
        write_state(path, &world, &state).map_err(|e| Report::msg(e.to_string()))?;
        if !arguments.json {
            say(format_args!("wrote {}", path.display()))?;
        }
    }
    Ok(if report.is_converged() { 0 } else { exit::NO_EQUILIBRIUM })
}

fn as_text(name: &str, report: &EquilibriumReport, moved: f64, weight: &[f64; 3]) -> String {
    let outcome = if report.is_converged() {
        "in equilibrium".to_string()
    } else {
        format!(
            "NO EQUILIBRIUM: only {:.1} % of the load is carried ({:?})",
            100.0 * report.reached,
            report.newton.status
        )
    };
    // Rounded to what is printed, so that no zero has a sign.
    let of = |v: &[f64]| {
        let [x, y, z] = [v[0], v[1], v[2]].map(|c| (c * 1e6).round() / 1e6 + 0.0);
        format!("({x:.6}, {y:.6}, {z:.6}) N")
    };
    let loaded = weight.iter().any(|c| *c != 0.0);
    let share = match loaded {
        true => format!(", {:.2e} of the forces", report.newton.relative_residual),
        false => ": no gravity acts, the body is as it was".to_string(),
    };
    format!(
        "{name}: {outcome}\n\
         load steps {}, halved {}; Newton iterations {}, line-search cuts {}, filtered {}, raised {}\n\
         residual {:.2e} N{}\n\
         reaction {}, weight {}\n\
         largest displacement {:.4} mm",
        report.load_steps,
        report.halvings,
        report.iterations,
        report.cuts,
        report.filtered,
        report.raised,
        report.newton.residual,
        share,
        of(report.reaction.as_slice()),
        of(weight),
        moved * 1e3
    )
}

fn as_json(report: &EquilibriumReport, moved: f64, weight: &[f64; 3]) -> serde_json::Value {
    json!({
        "converged": report.is_converged(),
        "reached": report.reached,
        "load_steps": report.load_steps,
        "halvings": report.halvings,
        "iterations": report.iterations,
        "cuts": report.cuts,
        "filtered": report.filtered,
        "raised": report.raised,
        "residual": report.newton.residual,
        "relative_residual": report.newton.relative_residual,
        "reaction": report.reaction.as_slice(),
        "weight": weight,
        "largest_displacement": moved,
    })
}
