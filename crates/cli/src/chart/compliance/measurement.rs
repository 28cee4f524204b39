//! One step of a run by each method: its time, and the error of forces and motion against those of the step's own matrix.

use cpu_time::ThreadTime;
use miette::{Result, miette};
use nalgebra::{DMatrix, DVector, Isometry3, Vector3};
use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::model::FemState;
use palpate::prelude::*;
use palpate::refresh::FactorSample;
use palpate::step::{GivenContact, StepInput, StepReport, StepState, StepStatus, StepWorkspace, step_at};

use super::body::{STEPS, contacts, world};
use super::method::{CORRECTIONS, Method, Outcome, Source};

/// Tolerance of the reference's solves: far below the errors that are looked for.
const TIGHT: f64 = 1e-10;

/// Most sweeps and iterations of the reference.
const MOST: u32 = 100_000;

/// The organ as a scene would name each method.
pub(crate) struct Worlds {
    reference: World,
    pub(crate) exact: World,
    /// With the factor of an earlier step, by [`CORRECTIONS`].
    asynchronous: [World; 2],
    /// Gathered from the precomputed inverse, by the same.
    pub(crate) gathered: [World; 2],
}

impl Worlds {
    pub(crate) fn new(organ: &Scene) -> Result<Self> {
        let of = |compliance, correction| {
            world(organ, compliance, |description| {
                description.bodies[0].correction = correction;
                // the inverse between the nodes of the skin of any size
                description.bodies[0].surface_memory = f64::MAX;
            })
        };
        let both =
            |compliance| Ok::<_, miette::Report>([of(compliance, CORRECTIONS[0])?, of(compliance, CORRECTIONS[1])?]);
        let tight = |description: &mut SceneDescription| {
            (description.bodies[0].tolerance, description.bodies[0].max_iterations) = (TIGHT, MOST as usize);
            (description.solver.tolerance, description.solver.max_sweeps) = (TIGHT, MOST);
        };
        Ok(Self {
            reference: world(organ, ComplianceMethod::Exact, tight)?,
            exact: of(ComplianceMethod::Exact, MotionCorrection::Exact)?,
            asynchronous: both(ComplianceMethod::Asynchronous)?,
            gathered: both(ComplianceMethod::Warped)?,
        })
    }

    fn of(&self, method: Option<Method>) -> &World {
        let Some(method) = method else { return &self.exact };
        let worlds = if method.source == Source::Gathered { &self.gathered } else { &self.asynchronous };
        let place = CORRECTIONS.iter().position(|correction| *correction == method.correction);
        &worlds[place.unwrap_or(0)]
    }
}

/// A step after a path, ready to be taken by every method.
pub(crate) struct Step<'w> {
    worlds: &'w Worlds,
    path: &'w [Vec<Vector3<f64>>],
    contacts: Vec<GivenContact>,
    fem: FemWorkspace,
    /// Compliance, forces and correction of the step's own matrix.
    exact: (DMatrix<f64>, DVector<f64>, Vec<f64>),
}

impl<'w> Step<'w> {
    /// The step after the path, with its exact solution.
    pub(crate) fn new(worlds: &'w Worlds, path: &'w [Vec<Vector3<f64>>]) -> Result<Self> {
        let world = &worlds.reference;
        let mut step = Self {
            worlds,
            path,
            contacts: contacts(world, &path[STEPS]),
            fem: FemWorkspace::new(world.model()),
            exact: (DMatrix::zeros(0, 0), DVector::zeros(0), Vec::new()),
        };
        let own = step.factor(0)?;
        let mut ws = step.workspace(world, None);
        step.take(world, &own, &mut ws)?;
        let view = ws.problem().view();
        let w = DMatrix::from_fn(view.rows(), view.rows(), |i, j| view.column(j)[i]);
        step.exact = (w, DVector::from_column_slice(ws.forces()), ws.correction().to_vec());
        Ok(step)
    }

    fn state(&self, k: usize) -> FemState {
        let world = &self.worlds.exact;
        let mut state = world.model().rest_state();
        let (now, before) = (&self.path[k], &self.path[k.saturating_sub(1)]);
        state.q.clone_from(now);
        for ((v, now), before) in state.v.iter_mut().zip(now).zip(before) {
            *v = (now - before) / world.dt();
        }
        state
    }

    /// The factor of the matrix that is `age` steps old, as the factor thread makes it.
    pub(crate) fn factor(&mut self, age: usize) -> Result<FactorSample> {
        let (world, k) = (&self.worlds.exact, STEPS - age);
        assemble(world.model(), &self.state(k), world.dt(), &[], &mut self.fem);
        let time = k as f64 * world.dt();
        FactorSample::new(world, 0, k as u64, time, &self.path[k], &self.fem.system)
            .map_err(|status| miette!("step {k} has no factor: {status:?}"))
    }

    /// The step by a method (`None`: the exact one, which factors first) with a factor, several times for its time.
    pub(crate) fn measure(&self, method: Option<Method>, factor: &FactorSample, times: usize) -> Result<Outcome> {
        let world = self.worlds.of(method);
        let gathered = method.is_some_and(|method| method.source == Source::Gathered);
        let mut ws = self.workspace(world, gathered.then_some(factor));
        let mut durations = Vec::with_capacity(times);
        let (mut report, time) = self.take(world, factor, &mut ws)?;
        durations.push(time);
        for _ in 1..times {
            let time;
            (report, time) = self.take(world, factor, &mut ws)?;
            durations.push(time);
        }
        durations.sort_by(f64::total_cmp);
        let (w, lambda, correction) = &self.exact;
        let wrong = DVector::from_column_slice(ws.forces()) - lambda;
        let energy = |x: &DVector<f64>| x.dot(&(w * x)).max(0.0).sqrt();
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
        let missed = norm(&mut ws.correction().iter().zip(correction).map(|(a, b)| a - b));
        Ok(Outcome {
            force: energy(&wrong) / energy(lambda),
            motion: missed / norm(&mut correction.iter().copied()),
            imbalance: imbalance(&ws, world.dt()),
            refined: report.error.refined,
            iterations: [report.free_motion.iterations, report.error.correction_iterations as usize],
            time: durations[durations.len() / 2],
        })
    }

    /// Memory of the step with its system in place, and with what is precomputed from `first`.
    fn workspace(&self, world: &World, first: Option<&FactorSample>) -> StepWorkspace {
        let mut ws = StepWorkspace::new(world);
        first.iter().for_each(|first| ws.precompute(world, first));
        assemble(world.model(), &self.state(STEPS), world.dt(), &[], &mut ws.fem);
        ws
    }

    /// The step of a run after its assembly, at the given contacts, and the time (s) that this core works for it.
    fn take(&self, world: &World, factor: &FactorSample, ws: &mut StepWorkspace) -> Result<(StepReport, f64)> {
        let mut state = StepState::new(world, self.state(STEPS));
        let input = StepInput { time: STEPS as f64 * world.dt(), tool: Isometry3::identity().into(), factor };
        let begin = ThreadTime::now();
        let report = step_at(world, &input, &self.contacts, &mut state, ws);
        let time = begin.elapsed().as_secs_f64();
        if report.status != StepStatus::Advanced || !report.compliance.usable {
            return Err(miette!("the measured step failed: {:?}", report.status));
        }
        Ok((report, time))
    }
}

/// What the last correction misses of the equations of motion, `‖A Δv - h Hᵀ λ‖ / ‖h Hᵀ λ‖`.
fn imbalance(ws: &StepWorkspace, dt: f64) -> f64 {
    let correction = ws.correction();
    let (mut load, mut moved) = (vec![0.0; correction.len()], vec![0.0; correction.len()]);
    ws.rows().tissue.add_transposed(ws.forces(), &mut load);
    load.iter_mut().for_each(|b| *b *= dt);
    ws.fem.system.multiply(correction, &mut moved);
    let missed: f64 = moved.iter().zip(&load).map(|(a, b)| (a - b) * (a - b)).sum();
    (missed / load.iter().map(|b| b * b).sum::<f64>()).sqrt()
}
