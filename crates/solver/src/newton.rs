//! Semismooth Newton on the equations [Alart and Curnier 1991], from a few sweeps of block Gauss-Seidel.
//!
//! Every law is an equation `F_a(delta_a, lambda_a) = 0` (see `Linearization`); with `delta = W lambda + delta_free`
//!
//! ```text
//! (dF/dlambda + dF/ddelta W) d = -F ,   lambda' = P(lambda + t d)
//! ```
//!
//! Blocks whose equation is `lambda_a = 0` are taken out of the system, which is so as large as the contacts that touch.
//! It is scaled to `sqrt(rho_a) W_ac sqrt(rho_c)`, of order one for any stiffness of the bodies.
//!
//! Rank-deficient `W` makes the system singular: `W_aa` is shifted by [`SHIFT`] of its mean diagonal. That is one step of
//! Newton on the proximal-point problem around the current forces, which has the same solutions, and it picks forces of
//! moderate size among many.
//!
//! Safeguards: of the steps `t` = 1, 1/2, 1/4, the first that lowers the natural-map residual is taken, else the one with
//! the least; after [`PATIENCE`] steps without a new best, or a singular system, the run goes back to the best forces and
//! does twice as many sweeps as the time before. Forces are projected, so that every iterate is admissible.
//!
//! The first factorisation on a thread allocates once (packing memory of faer's matrix products, kept for the thread);
//! nothing is allocated after that.

use crate::dense::LinearSystem;
use crate::gauss_seidel::{GaussSeidelWorkspace, residual, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::problem::{Block, ProblemView, gather, scatter};
use crate::report::SolveReport;
use crate::solver::ConstraintSolver;
use crate::watch::Watch;
use nalgebra::{Matrix3, Vector3};
use palpate_constraints::law::{Linearization, LocalCompliance};
use serde::{Deserialize, Serialize};

/// Shift of `W_aa` relative to its mean diagonal. Rounding of the factorisation is 1e-16 times the growth of a pivot or
/// so; with the shift a singular system is solved to about eight digits, and the convergence stays one digit short of
/// quadratic at worst.
pub const SHIFT: f64 = 1e-9;

/// Newton steps without a new best after which sweeps take over.
pub const PATIENCE: u32 = 6;

/// Largest number of sweeps between two attempts of Newton.
const MOST_SWEEPS: u32 = 400;

/// Parameters of the semismooth Newton method.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NewtonConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of iterations; a sweep and a Newton step count alike. Default 1000.
    pub max_iterations: u32,
    /// Sweeps of block Gauss-Seidel before the first step. Default 8.
    pub first_sweeps: u32,
    /// Iterations without a fall of the residual by a hundredth after which the run ends as stalled. Default 500.
    pub stall_iterations: u32,
}

impl Default for NewtonConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 1000, first_sweeps: 8, stall_iterations: 500 }
    }
}

/// Memory of the Newton method: `m^2` numbers for the system, and vectors.
#[derive(Clone, Debug)]
pub struct NewtonWorkspace {
    pub(crate) sweeps: GaussSeidelWorkspace,
    system: LinearSystem,
    equations: Vec<Linearization>,
    /// First unknown of each block in the system; none for blocks without force.
    unknown: Vec<Option<usize>>,
    /// Newton direction `d`, N.
    direction: Vec<f64>,
    /// `W d` of the blocks without force, m.
    gap: Vec<f64>,
    /// Forces before the step, N.
    before: Vec<f64>,
    /// Forces with the least residual of Newton's steps, N.
    kept: Vec<f64>,
}

/// Where the run stands between sweeps and Newton steps.
struct Phase {
    sweeps_left: u32,
    /// Length of the next series of sweeps.
    sweeps: u32,
    failures: u32,
    best: f64,
}

impl ConstraintSolver for NewtonConfig {
    const NAME: &'static str = "semismooth_newton";
    type Workspace = NewtonWorkspace;

    fn workspace(&self, rows: usize) -> NewtonWorkspace {
        let vector = || Vec::with_capacity(rows);
        NewtonWorkspace {
            sweeps: GaussSeidelWorkspace::with_capacity(rows),
            system: LinearSystem::with_capacity(rows),
            equations: Vec::with_capacity(rows),
            unknown: Vec::with_capacity(rows),
            direction: vector(),
            gap: vector(),
            before: vector(),
            kept: vector(),
        }
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_iterations: max_iterations.unwrap_or(self.max_iterations), ..self }
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut NewtonWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop =
            Stop { tolerance: self.tolerance, max_iterations: self.max_iterations, stall: self.stall_iterations };
        // Taken out for the time of the run, so that the method can borrow the rest.
        let mut sweeps = std::mem::take(&mut ws.sweeps);
        // A problem that does not fit is refused before the first iteration.
        let rows = view.rows().min(sweeps.capacity());
        for vector in [&mut ws.direction, &mut ws.gap, &mut ws.before, &mut ws.kept] {
            vector.clear();
            vector.resize(rows, 0.0);
        }
        let mut phase = Phase {
            sweeps_left: self.first_sweeps,
            sweeps: self.first_sweeps.max(4),
            failures: 0,
            best: f64::INFINITY,
        };
        let report = iteration::run(view, lambda, stop, &mut sweeps, watch, |lambda, sweeps, residual| {
            advance(view, lambda, residual, &mut phase, sweeps, ws)
        });
        ws.sweeps = sweeps;
        report
    }
}

/// One sweep or one Newton step.
fn advance(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    now: f64,
    phase: &mut Phase,
    sweeps: &mut GaussSeidelWorkspace,
    ws: &mut NewtonWorkspace,
) -> Advance {
    if phase.sweeps_left > 0 {
        phase.sweeps_left -= 1;
        sweep(view, lambda, 1.0, false, sweeps);
        return Advance::Updated;
    }
    if now < phase.best {
        // Back to short series of sweeps once Newton has taken hold.
        phase.failures = if now < 0.9 * phase.best { 0 } else { phase.failures + 1 };
        phase.best = now;
        ws.kept.copy_from_slice(lambda);
    } else {
        phase.failures += 1;
    }
    if phase.failures <= PATIENCE && direction(view, lambda, sweeps, ws) {
        step(view, lambda, sweeps, ws);
        return Advance::Formed;
    }
    lambda.copy_from_slice(&ws.kept);
    view.gap(lambda, &mut sweeps.delta);
    phase.failures = 0;
    phase.sweeps = (2 * phase.sweeps).min(MOST_SWEEPS);
    phase.sweeps_left = phase.sweeps;
    // Sweeps may pass through larger residuals on their way.
    phase.best = f64::INFINITY;
    Advance::Formed
}

/// Newton direction at the current forces; `false` where the system is singular.
#[allow(non_snake_case)]
fn direction(view: &ProblemView<'_>, lambda: &[f64], sweeps: &GaussSeidelWorkspace, ws: &mut NewtonWorkspace) -> bool {
    let size = linearize(view, lambda, sweeps, ws);
    let NewtonWorkspace { system, equations, unknown, direction, gap, .. } = ws;
    let scale = |local: &LocalCompliance| local.rho().sqrt();
    system.reset(size);
    let blocks = || view.blocks.iter().zip(&sweeps.local).zip(equations.iter().zip(unknown.iter()));
    for ((to, to_local), (_, first)) in blocks() {
        let Some(first_column) = *first else { continue };
        for j in 0..to.law.rows() {
            let compliance = view.column(to.start + j);
            let column = system.column_mut(first_column + j);
            for ((from, local), (equation, first)) in blocks() {
                let Some(first_row) = *first else { continue };
                let mut w = gather(compliance, from);
                let diagonal = first_row == first_column;
                if diagonal {
                    w[j] += SHIFT / local.rho();
                }
                let mut entries = equation.by_delta * w;
                if diagonal {
                    entries += equation.by_lambda.column(j);
                }
                entries *= scale(to_local) / scale(local);
                write(column, first_row, from, &entries);
            }
        }
    }
    let column = system.column_mut(size);
    for ((block, local), (equation, first)) in blocks() {
        let Some(first_row) = *first else { continue };
        let right = -(equation.value + equation.by_delta * gather(gap, block)) / scale(local);
        write(column, first_row, block, &right);
    }
    let Some(solution) = system.solve() else { return false };
    for ((block, local), (_, first)) in blocks() {
        let Some(first_row) = *first else { continue };
        let part = Block { start: first_row, law: block.law };
        scatter(&(gather(solution, &part) * scale(local)), block, direction);
    }
    true
}

/// The laws' equations, the numbers of the unknowns, and the direction of the blocks that are to carry no force with the
/// gap that it makes. Returns the number of unknowns.
fn linearize(view: &ProblemView<'_>, lambda: &[f64], sweeps: &GaussSeidelWorkspace, ws: &mut NewtonWorkspace) -> usize {
    ws.equations.clear();
    ws.unknown.clear();
    ws.gap.fill(0.0);
    let mut size = 0;
    for (block, local) in view.blocks.iter().zip(&sweeps.local) {
        let force = gather(lambda, block);
        let equation = block.law.linearize(local.rho(), &gather(&sweeps.delta, block), &force);
        // Laws whose force is fixed by itself, and blocks that no force moves.
        if equation.by_delta == Matrix3::zeros() && equation.by_lambda == Matrix3::identity() || local.is_rigid() {
            let change = if local.is_rigid() { -force } else { -equation.value };
            ws.unknown.push(None);
            scatter(&change, block, &mut ws.direction);
            for (j, force) in change.iter().enumerate().take(block.law.rows()) {
                if *force != 0.0 {
                    for (gap, w) in ws.gap.iter_mut().zip(view.column(block.start + j)) {
                        *gap += w * force;
                    }
                }
            }
        } else {
            ws.unknown.push(Some(size));
            size += block.law.rows();
        }
        ws.equations.push(equation);
    }
    size
}

/// The first of the steps 1, 1/2, 1/4 that lowers the residual, or the one with the least.
fn step(view: &ProblemView<'_>, lambda: &mut [f64], sweeps: &mut GaussSeidelWorkspace, ws: &mut NewtonWorkspace) {
    let now = residual(view, lambda, 1.0, sweeps).relative;
    ws.before.copy_from_slice(lambda);
    let mut take = |t: f64, lambda: &mut [f64]| {
        for block in view.blocks {
            let force = gather(&ws.before, block) + gather(&ws.direction, block) * t;
            scatter(&block.law.project(&force), block, lambda);
        }
        view.gap(lambda, &mut sweeps.delta);
        let reached = residual(view, lambda, 1.0, sweeps).relative;
        if reached.is_finite() { reached } else { f64::MAX }
    };
    let (mut best, mut least) = (1.0, f64::INFINITY);
    for t in [1.0, 0.5, 0.25] {
        let reached = take(t, lambda);
        if reached < now {
            return;
        }
        if reached < least {
            (best, least) = (t, reached);
        }
    }
    if best != 0.25 {
        take(best, lambda);
    }
}

/// Writes the entries of a block from `first` on.
fn write(column: &mut [f64], first: usize, block: &Block, entries: &Vector3<f64>) {
    scatter(entries, &Block { start: first, law: block.law }, column);
}
