//! `palpate plan`.

use std::time::Instant;

use comfy_table::{Cell, CellAlignment};
use miette::{Report, Result};
use nalgebra::Matrix3;
use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::counted::counted;
use palpate::fem::factor::{
    ChangeStatus, Factor, FactorPrecision, FactorStatus, MatrixChange, SolveWorkspace, SymbolicFactor, UpdateStatus,
};
use palpate::fem::pcg::{PcgConfig, PcgWorkspace, pcg};
use palpate::fem::preconditioner::WarpedPreconditioner;
use palpate::fem::sparse::SystemMatrix;
use palpate::scene::{IntegratorKind, Refactor, Scene};
use palpate::simulation::Simulation;
use palpate::step::StepTimes;
use palpate::world::{Plan, Sampling, World};
use std::sync::Arc;

use crate::output::say;
use crate::screen;

/// Contacts for which the rungs of a ladder are compared.
const CONTACTS: usize = 10;

/// Steps that are taken for a measurement; the median is what is told.
const STEPS: usize = 9;

pub(crate) fn plan(scene: &str, measure: bool) -> Result<u8> {
    let world = Scene::open(scene).map_err(super::report)?.build().map_err(super::report)?;
    say(format_args!("{}: {}", world.scene().name(), world.plan()))?;
    let mut table = screen::table();
    table.set_header(["", "predicted, nominal machine [ms]", "measured here [ms]"]);
    let mut simulation = Simulation::new(&world).map_err(|e| Report::msg(e.to_string()))?;
    let here = FactorTimes::measure(&world, &mut simulation)?;
    let measured = measure.then(|| times(&world, &mut simulation));
    let mut row = |name: &str, predicted: Option<f64>, measured: Option<f64>| {
        let cell = |v: Option<f64>| {
            Cell::new(v.map_or("-".into(), |v| format!("{:.2}", 1e3 * v))).set_alignment(CellAlignment::Right)
        };
        table.add_row([Cell::new(name), cell(predicted), cell(measured)]);
    };
    let plan = world.plan();
    row(factorization(&world), Some(plan.refresh()), Some(here.factorization));
    row("one solve with the factor", Some(plan.solve), Some(here.solve));
    row("one iteration with its copy in 16 bits", Some(plan.sampling.iteration), Some(here.iteration));
    row("the factor follows a change of one node", Some(plan.change_of_node()), here.change_of_node);
    if let Some(t) = &measured {
        for (name, time) in [
            ("assembly", t.assembly),
            ("free motion", t.free_motion),
            ("detection", t.detection),
            ("whole step, the tool where it begins", t.total),
        ] {
            row(name, None, Some(time));
        }
    }
    row("time that a step has", Some(world.dt()), None);
    for rung in plan.ladder.iter().flat_map(|ladder| ladder.rungs()) {
        let name = format!("{}: compliance and correction of {CONTACTS} contacts", rung.name());
        row(&name, Some(plan.rung_time(*rung, 3 * CONTACTS)), None);
    }
    say(table)?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let factor = if plan.has_factor_thread() { ", one of them also for the factor" } else { "" };
    say(format_args!("cores granted: {cores} to the step (--threads of `run` grants fewer){factor}"))?;
    if let Some(hint) = other_choice(&world, &here) {
        say(hint)?;
    }
    if let Some(coupling) = world.coupling() {
        say(format_args!("virtual coupling: {coupling}"))?;
    }
    world.warnings().iter().try_for_each(|warning| say(format_args!("warning: {warning}")))?;
    let bodies = world.bodies();
    if !bodies.is_empty() {
        let capacity = world.contact_capacity();
        say(format_args!(
            "{} fixed and {}, {} touch besides tool and tissue: at most {}, a \
             compliance of {:.1} MB; A⁻¹ of a rigid body is direct",
            bodies.fixed.len(),
            counted(bodies.rigid.len(), "rigid body", "rigid bodies"),
            counted(bodies.pairs.len(), "pair that can", "pairs that can"),
            counted(capacity, "contact", "contacts"),
            8e-6 * (3 * capacity).pow(2) as f64,
        ))?;
    }
    say(format_args!("error of the compliance: {}", error(plan)))?;
    Ok(0)
}

/// What a run will know of the error of its compliance.
fn error(plan: &Plan) -> String {
    let ladder = plan.ladder.is_some();
    if plan.compliance == ComplianceMethod::Exact && !ladder {
        return "none".into();
    }
    let Sampling { every, iterations, iteration } = plan.sampling;
    let along = match plan.correction {
        MotionCorrection::Exact => "known along the forces in every step",
        MotionCorrection::Matching => "not known along the forces (correction = \"matching\")",
    };
    let column = match every {
        0 => "no column is compared (error_sampling = 0)".into(),
        _ => {
            let when = if every == 1 { "every step".to_string() } else { format!("every {every} steps") };
            let most = 1e3 * iterations as f64 * iteration;
            format!(
                "one column is compared in {when}, within {}: {most:.2} ms predicted",
                counted(iterations, "iteration", "iterations")
            )
        }
    };
    format!("{along}; {column}")
}

/// When the factorisation happens.
fn factorization(world: &World) -> &'static str {
    match (world.description().bodies[0].integrator, world.plan().refactor) {
        (IntegratorKind::Newton, _) => "factorisation, in every Newton iteration",
        (IntegratorKind::Explicit, _) => "factorisation, before the first step only",
        (_, Refactor::Step) => "factorisation, in every step",
        (_, Refactor::Thread) if world.plan().precision == FactorPrecision::Single => {
            "factorisation, by its own thread in single precision"
        }
        (_, Refactor::Thread) => "factorisation, by its own thread",
        (_, Refactor::Once) => "factorisation, before the first step",
    }
}

/// Times of this body's own factor on this machine (s), on one core as the factor thread has.
struct FactorTimes {
    factorization: f64,
    /// In double precision, as a step would make it.
    in_step: f64,
    solve: f64,
    /// Of the conjugate gradients: the copy as preconditioner, the product with the matrix, and vectors.
    iteration: f64,
    /// For one node of [`CHANGED`]; none where a factor cannot be changed so.
    change_of_node: Option<f64>,
}

/// Iterations of the conjugate gradients that are timed together.
const ITERATIONS: usize = 10;

/// Nodes that are held fast to measure what a change costs.
const CHANGED: usize = 12;

impl FactorTimes {
    /// Medians with the matrix of a step.
    fn measure(world: &World, simulation: &mut Simulation<'_>) -> Result<Self> {
        simulation.step(&world.first_pose());
        let system = &simulation.workspace().fem.system;
        let mut factor = Factor::with_packed_copy(Arc::clone(world.symbolic()));
        if factor.refactor(system).status != FactorStatus::Ok {
            return Err(Report::msg("the matrix of the first step cannot be factored"));
        }
        let mut workspace = SolveWorkspace::new(world.symbolic());
        let mut x = simulation.workspace().fem.rhs.clone();
        let solve = median(|| _ = factor.solve(&mut x, &mut workspace));
        let iteration = iteration(system, &factor, &mut workspace, &simulation.workspace().fem.rhs);
        let change_of_node = change_of_node(world, system);
        let in_step = median(|| _ = factor.refactor(system));
        let factorization = match world.plan().precision {
            FactorPrecision::Double => in_step,
            single => {
                let mut factor = factor.computed_in(single);
                median(|| _ = factor.refactor(system))
            }
        };
        Ok(Self { factorization, in_step, solve, iteration, change_of_node })
    }
}

/// Time (s) of an iteration of the conjugate gradients with a factor that is turned with the nodes, as steps with an old one
/// make them.
fn iteration(system: &SystemMatrix, factor: &Factor, workspace: &mut SolveWorkspace, b: &[f64]) -> f64 {
    let nodes = system.pattern.rows();
    let (rotations, mut x, mut ws) = (vec![Matrix3::identity(); nodes], vec![0.0; b.len()], PcgWorkspace::new(nodes));
    // Out of reach, so that it takes all of them.
    let config = PcgConfig { relative_tolerance: f64::MIN_POSITIVE, max_iterations: ITERATIONS };
    let mut taken = 1;
    let time = median(|| {
        x.fill(0.0);
        let mut preconditioner = WarpedPreconditioner { factor, rotations: &rotations, workspace };
        taken = pcg(system, b, &mut x, &mut preconditioner, config, &mut ws).iterations.max(1);
    });
    time / taken as f64
}

/// Time (s) in which a factor follows a change of one of some nodes that lie scattered in the body.
fn change_of_node(world: &World, system: &SystemMatrix) -> Option<f64> {
    let (model, nodes) = (world.model(), world.model().free_nodes());
    let positions: Vec<_> = model.node_of_free().iter().map(|&node| world.mesh().nodes[node as usize]).collect();
    let symbolic = SymbolicFactor::new(model.pattern(), &positions).ok()?.with_room_for_changes(CHANGED);
    let mut factor = Factor::new(Arc::new(symbolic));
    let mut change = MatrixChange::with_capacity(nodes, CHANGED);
    let apart = nodes.div_ceil(CHANGED);
    let held: Vec<bool> = (0..nodes).map(|k| k % apart == 0).collect();
    let changed = change.between(system, system, &held) == ChangeStatus::Ok && !change.is_empty();
    if !changed || factor.refactor(system).status != FactorStatus::Ok {
        return None;
    }
    let mut followed = true;
    let time = median(|| followed &= factor.change(&change) == UpdateStatus::Ok);
    followed.then_some(time / change.nodes().len() as f64)
}

/// Median time of `work` (s).
fn median(mut work: impl FnMut()) -> f64 {
    let mut times = [(); STEPS].map(|()| {
        let begin = Instant::now();
        work();
        begin.elapsed().as_secs_f64()
    });
    times.sort_by(f64::total_cmp);
    times[STEPS / 2]
}

/// Whether this machine would have been planned for otherwise: the plan is made for a nominal one, so that a scene is
/// computed by the same methods everywhere.
fn other_choice(world: &World, here: &FactorTimes) -> Option<String> {
    let (body, plan) = (&world.description().bodies[0], world.plan());
    let chosen = plan.constant || plan.ladder.is_some();
    let automatic = body.compliance == ComplianceMethod::Automatic && body.refactor.is_none() && !chosen;
    let fits = here.in_step <= Plan::largest_in_step(world.dt());
    let milliseconds = 1e3 * here.in_step;
    match plan.refactor {
        Refactor::Thread if automatic && fits => Some(format!(
            "on this machine a factorisation takes {milliseconds:.1} ms and would fit in the step: \
             compliance = \"exact\" does so"
        )),
        Refactor::Step if automatic && !fits => Some(format!(
            "on this machine a factorisation takes {milliseconds:.1} ms, too long for the step: \
             compliance = \"asynchronous\" leaves it to a thread"
        )),
        _ => None,
    }
}

/// Medians over a few steps with the tool where it begins.
fn times(world: &World, simulation: &mut Simulation<'_>) -> StepTimes {
    let pose = world.first_pose();
    let mut steps = [(); STEPS].map(|()| simulation.step(&pose).times);
    steps.sort_by(|a, b| a.total.total_cmp(&b.total));
    steps[STEPS / 2]
}
