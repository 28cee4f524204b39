//! One step by each method: its time, and the error of forces and motion against those of the step's own matrix.

use std::sync::Arc;

use cpu_time::ThreadTime;
use miette::{Result, miette};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use palpate::constraints::compliance::{self, ComplianceMethod, ComplianceWorkspace, WarpedInverse};
use palpate::constraints::law::Coulomb;
use palpate::constraints::precomputed::{PrecomputedInverse, PrecomputedWorkspace};
use palpate::constraints::surface_inverse::SurfaceInverse;
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::factor::{Factor, FactorStatus, ReachWorkspace, SolveWorkspace};
use palpate::fem::model::FemState;
use palpate::fem::nodal_rows::NodalRows;
use palpate::fem::pcg::{PcgConfig, PcgWorkspace, pcg};
use palpate::fem::preconditioner::WarpedPreconditioner;
use palpate::fem::rotation::nodal_rotations;
use palpate::prelude::*;
use palpate::solver::problem::ConstraintProblem;
use palpate::solver::solver::{Solver, SolverWorkspace};

use super::body::{STEPS, contacts, skin, unturned};
use super::method::{Correction, Method, Outcome, Source};

/// Coefficient of friction.
const FRICTION: f64 = 0.3;

/// The contact solver's tolerance: far below the errors that are looked for.
const TOLERANCE: f64 = 1e-10;

/// The factor of an old matrix, and what was precomputed from it.
pub(crate) struct Old {
    pub(crate) factor: Factor,
    pub(crate) surface: Option<SurfaceInverse>,
}

/// A step of a body, ready to be taken by every method.
pub(crate) struct Step<'w> {
    world: &'w World,
    path: &'w [Vec<Vector3<f64>>],
    fem: FemWorkspace,
    rows: NodalRows,
    problem: ConstraintProblem,
    solver: Solver,
    solver_ws: SolverWorkspace,
    reach: ComplianceWorkspace<PrecomputedWorkspace>,
    solve: SolveWorkspace,
    pcg: PcgWorkspace,
    rotations: Vec<Matrix3<f64>>,
    v_free: Vec<f64>,
    lambda: Vec<f64>,
    before: Vec<f64>,
    motion: Vec<f64>,
    correction: Vec<f64>,
    load: Vec<f64>,
    /// Compliance, forces and correction of the step's own matrix.
    exact: (DMatrix<f64>, DVector<f64>, Vec<f64>),
}

impl<'w> Step<'w> {
    /// The step after the path, with its exact solution.
    pub(crate) fn new(world: &'w World, path: &'w [Vec<Vector3<f64>>]) -> Result<Self> {
        let (rows, gaps) = contacts(world, &path[STEPS]);
        let m = rows.len();
        let mut problem = ConstraintProblem::with_capacity(m);
        problem.reset(m).map_err(|e| miette!("{e}"))?;
        (0..m / 3).for_each(|_| problem.push_block(Coulomb { friction: FRICTION }.into()));
        problem.delta_free_mut().copy_from_slice(&gaps);
        let solver = Solver::from_name("gauss_seidel").ok_or_else(|| miette!("there is no such solver"))?;
        let solver = solver.limited(TOLERANCE, Some(100_000));
        let free = 3 * world.model().free_nodes();
        let reach = ReachWorkspace::new(world.symbolic(), m);
        let inverse = PrecomputedWorkspace::new(reach, SolveWorkspace::new(world.symbolic()));
        let mut step = Self {
            world,
            path,
            fem: FemWorkspace::new(world.model()),
            problem,
            solver,
            solver_ws: solver.workspace(m),
            reach: ComplianceWorkspace::new(m, inverse),
            solve: SolveWorkspace::new(world.symbolic()),
            pcg: PcgWorkspace::new(world.model().free_nodes()),
            rotations: unturned(world),
            v_free: vec![0.0; free],
            lambda: vec![0.0; m],
            before: vec![0.0; m],
            motion: vec![0.0; free],
            correction: vec![0.0; free],
            load: vec![0.0; free],
            exact: (DMatrix::zeros(m, m), DVector::zeros(m), vec![0.0; free]),
            rows,
        };
        step.assemble(STEPS);
        let mut own = step.old(STEPS, false)?;
        step.take(&mut own, None);
        let view = step.problem.view();
        let w = DMatrix::from_fn(m, m, |i, j| view.column(j)[i]);
        step.exact = (w, DVector::from_column_slice(&step.lambda), step.correction.clone());
        Ok(step)
    }

    fn state(&self, k: usize) -> FemState {
        let mut state = self.world.model().rest_state();
        let (now, before) = (&self.path[k], &self.path[k.saturating_sub(1)]);
        state.q.clone_from(now);
        for ((v, now), before) in state.v.iter_mut().zip(now).zip(before) {
            *v = (now - before) / self.world.dt();
        }
        state
    }

    /// Matrix and right side at step `k` of the path.
    fn assemble(&mut self, k: usize) {
        assemble(self.world.model(), &self.state(k), self.world.dt(), &[], &mut self.fem);
    }

    /// Memory for the factor of the step itself.
    pub(crate) fn own(&self) -> Old {
        Old { factor: Factor::new(Arc::clone(self.world.symbolic())), surface: None }
    }

    /// The factor of the matrix at step `k`, and the inverse between the nodes of the skin where wanted; leaves the matrix of
    /// the measured step behind.
    pub(crate) fn old(&mut self, k: usize, precompute: bool) -> Result<Old> {
        self.assemble(k);
        // As the factor thread makes it: conjugate gradients read it in 16 bits.
        let mut factor = Factor::with_packed_copy(Arc::clone(self.world.symbolic()));
        let status = factor.refactor(&self.fem.system).status;
        self.assemble(STEPS);
        if status != FactorStatus::Ok {
            return Err(miette!("step {k} has no factor: {status:?}"));
        }
        let invert = || SurfaceInverse::new(&factor, &skin(self.world), usize::MAX).map_err(|e| miette!("{e}"));
        let surface = precompute.then(invert).transpose()?;
        if let Some(surface) = &surface {
            self.reach.inverse_mut().make_room_for(surface);
        }
        Ok(Old { factor, surface })
    }

    /// The step by a method (`None`: the exact one, which factors first), several times for its time.
    pub(crate) fn measure(&mut self, old: &mut Old, method: Option<Method>, times: usize) -> Outcome {
        let mut durations = Vec::with_capacity(times);
        let mut iterations = [0; 2];
        for _ in 0..times.max(1) {
            let begin = ThreadTime::now();
            iterations = self.take(old, method);
            durations.push(begin.elapsed().as_secs_f64());
        }
        durations.sort_by(f64::total_cmp);
        let (w, lambda, correction) = &self.exact;
        let wrong = DVector::from_column_slice(&self.lambda) - lambda;
        let energy = |x: &DVector<f64>| x.dot(&(w * x)).max(0.0).sqrt();
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
        let missed = norm(&mut self.correction.iter().zip(correction).map(|(a, b)| a - b));
        Outcome {
            force: energy(&wrong) / energy(lambda),
            motion: missed / norm(&mut correction.iter().copied()),
            imbalance: self.imbalance(),
            iterations,
            time: durations[durations.len() / 2],
        }
    }

    /// What the last correction misses of the equations of motion.
    fn imbalance(&self) -> f64 {
        let (mut load, mut moved) = (vec![0.0; self.load.len()], vec![0.0; self.load.len()]);
        self.rows.add_transposed(&self.lambda, &mut load);
        load.iter_mut().for_each(|b| *b *= self.world.dt());
        self.fem.system.multiply(&self.correction, &mut moved);
        let missed: f64 = moved.iter().zip(&load).map(|(a, b)| (a - b) * (a - b)).sum();
        (missed / load.iter().map(|b| b * b).sum::<f64>()).sqrt()
    }

    /// Free motion, compliance, forces and correction; the iterations that they took.
    fn take(&mut self, old: &mut Old, method: Option<Method>) -> [usize; 2] {
        let Old { factor, surface } = old;
        let dt = self.world.dt();
        match method {
            None => {
                factor.refactor(&self.fem.system);
                self.rotations.fill(Matrix3::identity());
            }
            Some(method) if method.source != Source::Unwarped => {
                let from = &self.path[STEPS - method.age];
                nodal_rotations(self.world.model(), from, &self.path[STEPS], &mut self.rotations);
            }
            Some(_) => self.rotations.fill(Matrix3::identity()),
        }
        let config = PcgConfig { relative_tolerance: 1e-6, max_iterations: 500 };
        let system = &self.fem.system;
        let mut preconditioner =
            WarpedPreconditioner { factor, rotations: &self.rotations, workspace: &mut self.solve };
        self.v_free.fill(0.0);
        let free = pcg(system, &self.fem.rhs, &mut self.v_free, &mut preconditioner, config, &mut self.pcg);
        let gathered = method.is_some_and(|method| method.source == Source::Gathered);
        // Those of a factor of the step itself, or of an unwarped one, are none.
        let inverse = PrecomputedInverse { factor, surface: surface.as_ref().filter(|_| gathered) };
        let warped = WarpedInverse::new(ComplianceMethod::Asynchronous, inverse, &self.rotations);
        compliance::assemble(warped, &self.rows, dt, self.problem.compliance_mut(), &mut self.reach);
        self.lambda.fill(0.0);
        self.solver.solve(&self.problem.view(), &mut self.lambda, &mut self.solver_ws);
        compliance::correct(warped, &self.lambda, dt, &mut self.correction, &mut self.reach);
        let correction = method.map_or(Correction::Matching, |method| method.correction);
        let mut corrected = 0;
        if correction != Correction::Matching {
            corrected += self.correct_exactly(factor, config);
        }
        if correction == Correction::Refined {
            corrected += self.refine(inverse, config);
        }
        [free.iterations, corrected]
    }

    /// `A Δv = h Hᵀ λ`, from the correction at hand; the iterations.
    fn correct_exactly(&mut self, factor: &Factor, config: PcgConfig) -> usize {
        self.load.fill(0.0);
        self.rows.add_transposed(&self.lambda, &mut self.load);
        let dt = self.world.dt();
        self.load.iter_mut().for_each(|b| *b *= dt);
        let mut preconditioner =
            WarpedPreconditioner { factor, rotations: &self.rotations, workspace: &mut self.solve };
        pcg(&self.fem.system, &self.load, &mut self.correction, &mut preconditioner, config, &mut self.pcg).iterations
    }

    /// The forces once more with `(W_A - W) λ` added to the gaps, and the exact motion under them, as a run does.
    fn refine(&mut self, inverse: PrecomputedInverse<'_>, config: PcgConfig) -> usize {
        let dt = self.world.dt();
        let view = self.problem.view();
        let expected = |r: usize| view.column(r).iter().zip(&self.lambda).map(|(w, l)| w * l).sum::<f64>();
        let shift: Vec<f64> =
            (0..self.rows.len()).map(|r| dt * self.rows.dot(r, &self.correction) - expected(r)).collect();
        self.before.copy_from_slice(&self.lambda);
        self.motion.copy_from_slice(&self.correction);
        self.problem.delta_free_mut().iter_mut().zip(&shift).for_each(|(gap, shift)| *gap += shift);
        self.solver.solve(&self.problem.view(), &mut self.lambda, &mut self.solver_ws);
        self.problem.delta_free_mut().iter_mut().zip(&shift).for_each(|(gap, shift)| *gap -= shift);
        self.before.iter_mut().zip(&self.lambda).for_each(|(before, now)| *before = now - *before);
        let warped = WarpedInverse::new(ComplianceMethod::Asynchronous, inverse, &self.rotations);
        compliance::correct(warped, &self.before, dt, &mut self.correction, &mut self.reach);
        self.correction.iter_mut().zip(&self.motion).for_each(|(motion, before)| *motion += before);
        self.correct_exactly(inverse.factor, config)
    }
}
