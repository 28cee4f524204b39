//! Semismooth Newton on the equations [Alart and Curnier 1991], from sweeps of block Gauss-Seidel (see `rough_sweeps`).
//!
//! Every law is an equation `F_a(delta_a, lambda_a) = 0` (see `Linearization`); with `delta = W lambda + delta_free`
//!
//! ```text
//! (dF/dlambda + dF/ddelta W) d = -F ,   lambda' = P(lambda + t d)
//! ```
//!
//! Forces that the laws give are taken out of the system exactly (see `active_system`): three unknowns for a contact that
//! sticks, two for one that slides, none for one that is open. It is scaled to order one for any stiffness of the bodies.
//!
//! A step needs few digits [Dembo, Eisenstat and Steihaug 1982]: the system is solved by GMRES with a
//! block Gauss-Seidel preconditioner on the columns of `W` in single precision (see `krylov`), to as much of the residual
//! as the step can use. Where GMRES does not converge, and where it is dearer than that, the system is factored in double
//! precision, if the time that is left allows for it.
//!
//! Rank-deficient and nearly singular `W` (more rows than the nodes beneath have degrees of freedom) are met by
//! proximal points (see `proximal`): the steps solve regularised problems whose shift goes to zero with the residual.
//! On well-conditioned `W` every step has its own centre, and nothing is lost.
//!
//! Safeguards: of the steps `t` = 1, 1/2, 1/4, the first that lowers the residual of the regularised problem is taken,
//! else the one with the least; a regularised problem that is not solved in some steps begins again with a larger
//! shift; where that does not help, or the system is singular, the run goes back to the best forces and does twice as
//! many sweeps as the time before. Forces are projected, so that every iterate is admissible.
//!
//! Nothing is allocated; for what a thread needs before its first factorisation see [`crate::solver::warm_thread`].

use crate::active_system::{ActiveSystem, Way};
use crate::dense::warm_thread;
use crate::gauss_seidel::{GaussSeidelWorkspace, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::problem::{ProblemView, gather, scatter};
use crate::proximal::{Course, ProximalPoint};
use crate::report::SolveReport;
use crate::residual::scale;
use crate::rough_sweeps::{End, Limits, RoughSweeps};
use crate::solver::ConstraintSolver;
use crate::vectors::form_gap;
use crate::watch::Watch;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Error of a step's linear system relative to the residual that is asked for after it: near the solution the residual
/// becomes that error to a few per cent.
const FORCING: f64 = 0.7;

/// Bounds of the error of a step's linear system, relative to the residual, while the active contacts are sought: such a step
/// cannot use more digits, and the steps after it are cheap.
const LEAST_FORCING: f64 = 0.03;
const MOST_FORCING: f64 = 0.1;

/// Error of a step's linear system relative to the square of the residual, below the bound above: where the active
/// contacts are found a step squares the residual, and one with all digits that it can use costs less than two. Single
/// precision ends at [`EXACT`].
const SQUARED: f64 = 10.0;
const EXACT: f64 = 1e-4;

/// Operations per second that a factorisation is taken to do, for the decision whether it fits the time that is left.
const FACTORISATION_RATE: f64 = 2e9;

/// Sweeps in double precision before the first step, where those in single precision cannot do: with 2 or 3 more steps
/// are needed, at the price of more than a sweep each, and 6 gain nothing.
const FIRST_SWEEPS: u32 = 4;

/// Change of the forces in a rough sweep, relative to the scale of the residual, below which the steps begin: they
/// are sooner done from there, and a step costs as much as ten or so of these sweeps.
const ROUGH: f64 = 5e-4;

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
    /// Most sweeps of block Gauss-Seidel before the first step. Where all blocks are frictional contacts, they
    /// are done in single precision and end where they gain little; else there are at most 4. Default 32: a
    /// tool on a flat face finds its contacts in about 30, and with 16 twice as many steps are needed after them.
    pub first_sweeps: u32,
    /// Iterations without a fall of the residual by a hundredth after which the run ends as stalled. Default 500.
    pub stall_iterations: u32,
}

impl Default for NewtonConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 1000, first_sweeps: 32, stall_iterations: 500 }
    }
}

/// Memory of the Newton method: `m^2` numbers for the system, and vectors.
#[derive(Clone, Debug)]
pub struct NewtonWorkspace {
    pub(crate) sweeps: GaussSeidelWorkspace,
    system: ActiveSystem,
    rough: RoughSweeps,
    proximal: ProximalPoint,
    /// Forces before the step, N.
    before: Vec<f64>,
    /// Forces with the least residual of Newton's steps, N.
    kept: Vec<f64>,
}

/// Where the run stands between sweeps and Newton steps.
struct Phase {
    sweeps_left: u32,
    /// Sweeps in single precision instead.
    rough: u32,
    /// Length of the next series of sweeps.
    sweeps: u32,
    /// Residual of `NewtonWorkspace::kept`.
    best: f64,
    /// Length that residuals are relative to, m.
    scale: f64,
    deadline: Option<Instant>,
}

impl ConstraintSolver for NewtonConfig {
    const NAME: &'static str = "semismooth_newton";
    type Workspace = NewtonWorkspace;

    fn workspace(&self, rows: usize) -> NewtonWorkspace {
        let vector = || Vec::with_capacity(rows);
        warm_thread();
        NewtonWorkspace {
            sweeps: GaussSeidelWorkspace::with_capacity(rows),
            system: ActiveSystem::with_capacity(rows),
            rough: RoughSweeps::with_capacity(rows),
            proximal: ProximalPoint::with_capacity(rows),
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
        ws.system.begin(rows);
        ws.proximal.begin(rows);
        for vector in [&mut ws.before, &mut ws.kept] {
            vector.clear();
            vector.resize(rows, 0.0);
        }
        let first = self.first_sweeps.min(self.max_iterations);
        let rough = if RoughSweeps::applies(view) { first } else { 0 };
        let mut phase = Phase {
            sweeps_left: if rough > 0 { 0 } else { first.min(FIRST_SWEEPS) },
            rough,
            sweeps: FIRST_SWEEPS,
            best: f64::INFINITY,
            scale: if view.is_consistent() { scale(view).unwrap_or(1.0) } else { 1.0 },
            deadline: watch.deadline(),
        };
        let report = iteration::run(view, lambda, stop, &mut sweeps, watch, |lambda, sweeps, residual| {
            advance(view, lambda, residual, self.tolerance, &mut phase, sweeps, ws)
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
    tolerance: f64,
    phase: &mut Phase,
    sweeps: &mut GaussSeidelWorkspace,
    ws: &mut NewtonWorkspace,
) -> Advance {
    if phase.sweeps_left > 0 {
        phase.sweeps_left -= 1;
        sweep(view, lambda, 1.0, false, sweeps);
        return Advance::Updated;
    }
    // Single precision would spoil what is better than it already.
    let rough = std::mem::take(&mut phase.rough);
    if rough > 0 && now > ROUGH {
        let change = phase.scale * ROUGH.max(tolerance);
        let limits = Limits { sweeps: rough, change, deadline: phase.deadline };
        let (done, end) = ws.rough.run(view, &sweeps.local, &sweeps.delta, &mut ws.system.single, lambda, limits);
        match end {
            // A step from here leaves more than the rounding of these gaps.
            End::Settled if ws.rough.gap_into(view, &ws.system.single, &mut sweeps.delta) => {
                return Advance::Rough(done);
            }
            End::Settled => {}
            End::Limit => ws.proximal.expect_singular(),
            End::Refused => phase.sweeps_left = rough.min(FIRST_SWEEPS),
        }
        form_gap(view, lambda, &mut sweeps.delta);
        return Advance::Several(done);
    }
    if now < phase.best {
        phase.best = now;
        ws.kept.copy_from_slice(lambda);
    }
    let course = ws.proximal.course(lambda, now, tolerance);
    if course == Course::Repeat {
        lambda.copy_from_slice(&ws.proximal.centre);
        form_gap(view, lambda, &mut sweeps.delta);
    }
    if course != Course::End {
        // As many digits as are asked for, and no more than a step can use.
        let least = (SQUARED * ws.proximal.residual).clamp(EXACT, LEAST_FORCING);
        let accuracy = (FORCING * tolerance / ws.proximal.residual).clamp(least, MOST_FORCING);
        let seconds = phase.deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()).as_secs_f64());
        let largest_factor = seconds.map_or(usize::MAX, |left| (1.5 * left * FACTORISATION_RATE).cbrt() as usize);
        let way = Way { shift: ws.proximal.shift, accuracy, largest_factor };
        ws.proximal.regularise(view, &sweeps.local, &sweeps.delta, lambda);
        if ws.system.solve(view, &sweeps.local, &ws.proximal.gap, lambda, &way) {
            ws.proximal.residual = step(view, lambda, phase.scale, sweeps, ws);
            return Advance::Formed;
        }
    }
    lambda.copy_from_slice(&ws.kept);
    view.gap(lambda, &mut sweeps.delta);
    ws.proximal.restart();
    phase.sweeps = (2 * phase.sweeps).min(MOST_SWEEPS);
    phase.sweeps_left = phase.sweeps;
    // Sweeps may pass through larger residuals on their way.
    phase.best = f64::INFINITY;
    Advance::Formed
}

/// The first of the steps 1, 1/2, 1/4 that lowers the regularised residual, or the one with the least; returns that residual.
fn step(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    scale: f64,
    sweeps: &mut GaussSeidelWorkspace,
    ws: &mut NewtonWorkspace,
) -> f64 {
    let NewtonWorkspace { system, proximal, before, .. } = ws;
    before.copy_from_slice(lambda);
    let now = proximal.residual;
    let mut take = |t: f64, lambda: &mut [f64]| {
        for block in view.blocks {
            let force = gather(before, block) + gather(&system.rows.direction, block) * t;
            scatter(&block.law.project(&force), block, lambda);
        }
        form_gap(view, lambda, &mut sweeps.delta);
        proximal.judge(view, &sweeps.local, &sweeps.delta, lambda, scale)
    };
    let (mut best, mut least) = (1.0, f64::INFINITY);
    for t in [1.0, 0.5, 0.25] {
        let reached = take(t, lambda);
        if reached < now {
            return reached;
        }
        if reached < least {
            (best, least) = (t, reached);
        }
    }
    if best == 0.25 { least } else { take(best, lambda) }
}
