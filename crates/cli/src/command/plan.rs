//! `palpate plan`.

use std::time::Instant;

use comfy_table::{Cell, CellAlignment, Table, presets};
use miette::{Report, Result};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::fem::factor::Factor;
use palpate::scene::{IntegratorKind, Refactor, Scene};
use palpate::simulation::Simulation;
use palpate::step::StepTimes;
use palpate::world::World;
use std::sync::Arc;

use crate::output::say;

/// Steps that are taken for a measurement; the median is what is told.
const STEPS: usize = 9;

pub(crate) fn plan(scene: &str, measure: bool) -> Result<u8> {
    let world = Scene::open(scene).map_err(super::report)?.build().map_err(super::report)?;
    say(format_args!("{}: {}", world.scene().name(), world.plan()))?;
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(["", "predicted [ms]", "measured [ms]"]);
    let measured = if measure { Some(times(&world)?) } else { None };
    let mut row = |name: &str, predicted: Option<f64>, measured: Option<f64>| {
        let cell = |v: Option<f64>| {
            Cell::new(v.map_or("-".into(), |v| format!("{:.2}", 1e3 * v))).set_alignment(CellAlignment::Right)
        };
        table.add_row([Cell::new(name), cell(predicted), cell(measured)]);
    };
    let plan = world.plan();
    row(factorization(&world), Some(plan.factorization), measured.as_ref().map(|m| m.factorization));
    row("one solve with the factor", Some(plan.solve), None);
    if let Some(Measured { step: t, .. }) = &measured {
        for (name, time) in [
            ("assembly", t.assembly),
            ("free motion", t.free_motion),
            ("detection", t.detection),
            ("step without contact", t.total),
        ] {
            row(name, None, Some(time));
        }
    }
    row("time that a step has", Some(world.dt()), None);
    say(table)?;
    let bodies = world.bodies();
    if !bodies.is_empty() {
        let capacity = world.contact_capacity();
        say(format_args!(
            "{} fixed and {} rigid bodies, {} pairs that can touch besides tool and tissue: at most {capacity} contacts, a \
             compliance of {:.1} MB; A⁻¹ of a rigid body is direct",
            bodies.fixed.len(),
            bodies.rigid.len(),
            bodies.pairs.len(),
            8e-6 * (3 * capacity).pow(2) as f64,
        ))?;
    }
    say(format_args!(
        "error of the compliance: {}",
        match (plan.compliance, plan.sample_iterations) {
            (ComplianceMethod::Exact, _) => "none".to_string(),
            (_, 0) =>
                "known along the forces; comparing a column as well takes more than `error_sampling` grants".into(),
            (_, n) => format!("known along the forces, and of one column a step within {n} iterations"),
        }
    ))?;
    Ok(0)
}

/// When the factorisation happens.
fn factorization(world: &World) -> &'static str {
    match (world.description().bodies[0].integrator, world.plan().refactor) {
        (IntegratorKind::Newton, _) => "factorisation, in every Newton iteration",
        (IntegratorKind::Explicit, _) => "factorisation, before the first step only",
        (_, Refactor::Step) => "factorisation, in every step",
        (_, Refactor::Thread) => "factorisation, by its own thread",
        (_, Refactor::Once) => "factorisation, before the first step",
    }
}

struct Measured {
    factorization: f64,
    step: StepTimes,
}

/// Medians over a few steps with the tool where it begins.
fn times(world: &World) -> Result<Measured> {
    let mut simulation = Simulation::new(world).map_err(|e| Report::msg(e.to_string()))?;
    let pose = world.first_pose();
    let mut steps: Vec<StepTimes> = (0..STEPS).map(|_| simulation.step(&pose).times).collect();
    steps.sort_by(|a, b| a.total.total_cmp(&b.total));
    let mut factor = Factor::new(Arc::clone(world.symbolic()));
    let mut factorizations: Vec<f64> = (0..STEPS)
        .map(|_| {
            let begin = Instant::now();
            factor.refactor(&simulation.workspace().fem.system);
            begin.elapsed().as_secs_f64()
        })
        .collect();
    factorizations.sort_by(f64::total_cmp);
    Ok(Measured { factorization: factorizations[STEPS / 2], step: steps[STEPS / 2] })
}
