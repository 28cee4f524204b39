//! The contact methods on one scene: the ball that presses the bundled block and slides. From the same states on the way of a
//! reference, one step each by every method: error of the force against the time of the step.

use miette::{Result, miette};
use nalgebra::{Isometry3, Vector3};
use palpate::collision::ToolPose;
use palpate::collision::contact::ContactSet;
use palpate::constraints::compliance::ComplianceMethod;
use palpate::constraints::penalty::PenaltyConfig;
use palpate::constraints::warm_start::WarmStart;
use palpate::fem::model::FemState;
use palpate::prelude::*;
use palpate::scene::ContactMethod;
use palpate::step::{StepReport, StepStatus};

use crate::chart::{Settings, Work};

/// Steps of the reference: down, aside.
const STEPS: u64 = 30;

/// Repetitions of each step but those of Lagrange multipliers, which take seconds.
const REPETITIONS: usize = 5;

/// Time (s) of a step without the snapshot, and without the compliance where only the tick needs it.
fn time_of(method: ContactMethod, report: &StepReport) -> f64 {
    let of_tick = if method == ContactMethod::Compliance { 0.0 } else { report.times.compliance };
    report.times.total - report.times.hand_over - of_tick
}

/// One choice of method.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Choice {
    /// Series in the picture.
    pub(crate) name: &'static str,
    method: ContactMethod,
    compliance: ComplianceMethod,
    /// Tolerance of the contact solve.
    pub(crate) tolerance: f64,
    /// Stiffness of a penalty relative to the body's; 0 for the others.
    pub(crate) multiple: f64,
}

/// What is measured.
pub(crate) fn choices(quick: bool) -> Vec<Choice> {
    let exact = ComplianceMethod::Exact;
    let choice = |name, method, compliance, tolerance| Choice { name, method, compliance, tolerance, multiple: 0.0 };
    let mut choices = Vec::new();
    let tolerances: &[f64] = if quick { &[1e-4] } else { &[1e-1, 1e-2, 1e-4, 1e-6] };
    for &tolerance in tolerances {
        let asynchronous = ComplianceMethod::Asynchronous;
        choices.push(choice(
            "compliance, factor of the step before",
            ContactMethod::Compliance,
            asynchronous,
            tolerance,
        ));
        choices.push(choice("compliance, exact", ContactMethod::Compliance, exact, tolerance));
    }
    for &tolerance in if quick { &[1e-4][..] } else { &[1e-2, 1e-6] } {
        choices.push(choice("Lagrange multipliers", ContactMethod::Lagrange, ComplianceMethod::default(), tolerance));
    }
    for &multiple in if quick { &[1.0, 100.0][..] } else { &[1.0, 10.0, 100.0, 1e3, 1e4] } {
        let penalty = choice("penalty", ContactMethod::Penalty, ComplianceMethod::default(), 1e-6);
        choices.push(Choice { multiple, ..penalty });
    }
    choices
}

/// What a choice answers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answer {
    /// Error of the force relative to the reference, root mean square over the states.
    pub(crate) error: f64,
    /// Median time of a step without what only the tick needs (s).
    pub(crate) time: f64,
    /// Iterations of the contact solve, mean.
    pub(crate) iterations: f64,
    /// Largest natural-map residual.
    pub(crate) residual: f64,
}

/// What a step begins with.
struct Begin {
    fem: FemState,
    tool: Option<ToolPose>,
    contacts: ContactSet,
    warm_start: WarmStart,
}

/// States of the reference before each of its steps, and its forces (N).
pub(crate) struct Reference {
    begins: Vec<Begin>,
    forces: Vec<Vector3<f64>>,
    cells: [usize; 3],
    samples: Vec<usize>,
}

fn world(cells: [usize; 3], choice: &Choice, body_tolerance: f64) -> Result<World> {
    let mut scene = Scene::bundled("block").map_err(|e| miette!("{e}"))?;
    let change = |scene: &mut SceneDescription| {
        if let Some(block) = &mut scene.bodies[0].block {
            block.cells = cells;
        }
        scene.contact.method = choice.method;
        scene.contact.penalty = (choice.method == ContactMethod::Penalty).then(|| PenaltyConfig {
            multiple: choice.multiple,
            damping: 0.0,
            ..PenaltyConfig::default()
        });
        scene.bodies[0].compliance = choice.compliance;
        scene.bodies[0].tolerance = body_tolerance;
        (scene.solver.tolerance, scene.solver.max_sweeps) = (choice.tolerance, 20_000);
    };
    scene.edit(change).map_err(|e| miette!("{e}"))?;
    scene.build().map_err(|e| miette!("{e}"))
}

/// Place of the ball: 6 mm into the block, then 8 mm aside.
fn pose(world: &World, k: usize) -> Isometry3<f64> {
    let part = |from: f64, to: f64| ((k as f64 - from) / (to - from)).clamp(0.0, 1.0);
    Isometry3::translation(8e-3 * part(15.0, 30.0), 0.0, -10e-3 * part(0.0, 15.0)) * world.first_pose()
}

impl Reference {
    /// Runs the reference: exact compliance, solved far below what is compared.
    pub(crate) fn new(settings: &Settings) -> Result<Self> {
        let (cells, samples) =
            if settings.quick { ([5, 5, 3], vec![14, 24]) } else { ([8, 8, 4], vec![10, 14, 18, 22, 26, 29]) };
        let choice = Choice {
            name: "reference",
            method: ContactMethod::Compliance,
            compliance: ComplianceMethod::Exact,
            tolerance: 1e-10,
            multiple: 0.0,
        };
        let world = world(cells, &choice, 1e-11)?;
        let mut sim = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
        let (mut begins, mut forces) = (Vec::new(), Vec::new());
        for k in 0..STEPS as usize {
            let state = sim.state();
            begins.push(Begin {
                fem: state.fem.clone(),
                tool: state.tool,
                contacts: state.contacts.clone(),
                warm_start: state.warm_start.clone(),
            });
            forces.push(sim.step(&pose(&world, k)).force);
        }
        Ok(Self { begins, forces, cells, samples })
    }

    fn step(&self, sim: &mut Simulation<'_>, k: usize) -> Result<StepReport> {
        let (begin, state) = (&self.begins[k], sim.state_mut());
        (state.fem, state.tool) = (begin.fem.clone(), begin.tool);
        (state.contacts, state.warm_start) = (begin.contacts.clone(), begin.warm_start.clone());
        let report = sim.step(&pose(sim.world(), k));
        match report.status {
            StepStatus::Advanced => Ok(report),
            StepStatus::RolledBack => Err(miette!("step {k} failed")),
        }
    }

    /// One step by the chosen method from each of the states; the factor is that of the step before.
    pub(crate) fn measure(&self, choice: &Choice, work: &Work) -> Result<Answer> {
        let world = world(self.cells, choice, 1e-6)?;
        let mut sim = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
        let (mut squares, mut iterations, mut residual) = (0.0, 0.0, 0.0f64);
        let mut times = Vec::new();
        for &k in self.samples.iter().take_while(|_| !work.stopped()) {
            // The same step again and again has one answer; its least time is the one that nothing else disturbed.
            let (mut best, mut report) = (f64::INFINITY, None);
            for _ in 0..if choice.method == ContactMethod::Lagrange { 1 } else { REPETITIONS } {
                self.step(&mut sim, k - 1)?;
                let again = self.step(&mut sim, k)?;
                best = best.min(time_of(choice.method, &again));
                report = Some(again);
            }
            let Some(report) = report else { continue };
            squares += ((report.force - self.forces[k]).norm() / self.forces[k].norm()).powi(2);
            iterations += f64::from(report.solve.iterations);
            residual = residual.max(report.solve.residual);
            times.push(best);
        }
        let n = times.len().max(1) as f64;
        times.sort_by(f64::total_cmp);
        let time = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
        Ok(Answer { error: f64::sqrt(squares / n), time, iterations: iterations / n, residual })
    }
}
