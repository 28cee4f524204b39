//! Lagrange multipliers over the whole body, the second of the lecture's direct approaches: one program of motion and
//! contact, without compliance.
//!
//! ```text
//! minimise 1/2 wᵀ A w   with   δ = δ_free + h H w   and   (δ_n + s, δ_t) in the dual of each force cone
//! its multipliers are the forces:  A w = h Hᵀ λ ,  λ in the cone ,  (δ_n + s) λ_n + δ_t · λ_t = 0
//! ```
//!
//! `w = v⁺ - v_free` (m/s), so that `δ_free` says what the right side of the body's own system would. Without friction
//! this is one quadratic program. With friction the cones are `δ_n + s >= μ |δ_t|`, and `s = μ |δ_t|` (De Saxcé's
//! correction) is iterated outside as in [`crate::conic_friction`], which is the same sequence of programs after `w`
//! has been eliminated.
//!
//! Clarabel's interior-point method factors the sparse system of body and contacts anew in every iteration: a body of 1,000
//! nodes costs tenths of a second a program, one of 10,000 nodes minutes. It starts every program from its own point. A
//! comparison method at step rate.

mod program;

use crate::conic::{Corrections, Until};
use crate::open_contacts::release;
use crate::problem::ProblemView;
use crate::report::{SolveReport, SolveStatus};
use crate::residual::{natural_map, scale};
use crate::watch::Watch;
use program::KeptProgram;

/// A fall of the residual by less than this part, so many programs in a row, ends a run as stalled.
const NOTABLE: f64 = 0.99;
const STALL: u32 = 10;

/// The body and its contacts in one step.
#[derive(Clone, Copy, Debug)]
pub struct LagrangeProblem<'a> {
    /// Upper triangle of `A` (kg) by columns: start of each column, and one past the last.
    pub column_start: &'a [usize],
    /// Row of each entry.
    pub row: &'a [usize],
    /// The entries (kg).
    pub value: &'a [f64],
    /// `H`: row, degree of freedom, value.
    pub jacobian: &'a [(usize, usize, f64)],
    /// Step `h` (s).
    pub dt: f64,
    /// Laws and gaps. Of the compliance only the diagonal blocks are read, for scaling and for the residual.
    pub view: ProblemView<'a>,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LagrangeConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of programs; without friction there is one. Default 200.
    pub max_programs: u32,
}

impl Default for LagrangeConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_programs: 200 }
    }
}

/// Memory of the method: the program that was laid out last, whose order and memory serve as long as body and contacts
/// have the entries that they had, and vectors.
#[derive(Default)]
pub struct LagrangeWorkspace {
    kept: KeptProgram,
    corrections: Corrections,
    delta: Vec<f64>,
    motion: Vec<f64>,
    force: Vec<f64>,
}

impl std::fmt::Debug for LagrangeWorkspace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LagrangeWorkspace").finish_non_exhaustive()
    }
}

/// Solves for the motion `w` (m/s) that contact adds, and its forces (N): finite and admissible whatever the status.
///
/// Open contacts have no force at all: what a program leaves there is taken off, and the balance is off by as much, which is
/// within the tolerance.
///
/// Takes laws whose forces are all, not negative, or in a second-order cone; others end as
/// [`SolveStatus::Unsupported`]. The report counts interior-point iterations: factorisations of the system of body and
/// contacts. Allocates where the entries of `A` or of `H` or the cones are not those of the last call: Clarabel orders and
/// lays out a program from its entries, and takes no memory from outside.
pub fn solve(
    problem: &LagrangeProblem<'_>,
    config: &LagrangeConfig,
    w: &mut [f64],
    lambda: &mut [f64],
    ws: &mut LagrangeWorkspace,
) -> SolveReport {
    solve_watched(problem, config, w, lambda, ws, &mut Watch::none())
}

/// The same with a limit of time. The clock is looked at before a program is laid out, before it is solved, and after each
/// of its interior-point iterations; one factorisation and the laying out, which orders the entries, are not
/// interrupted. Where the time is over, the run ends as [`SolveStatus::TimeLimit`] with motion and forces of the program
/// with the least residual so far: zero where none was finished. The watch records programs, by their factorisations.
pub fn solve_watched(
    problem: &LagrangeProblem<'_>,
    config: &LagrangeConfig,
    w: &mut [f64],
    lambda: &mut [f64],
    ws: &mut LagrangeWorkspace,
    watch: &mut Watch<'_>,
) -> SolveReport {
    w.fill(0.0);
    lambda.fill(0.0);
    let view = &problem.view;
    let Some(scale) = scale(view) else {
        return SolveReport { residual: 0.0, worst_gap: 0.0, ..SolveReport::failed(SolveStatus::Solved, 0) };
    };
    if lambda.len() != view.rows() {
        return SolveReport::failed(SolveStatus::Invalid, 0);
    }
    let deadline = watch.deadline();
    if (Until { deadline, ..Until::default() }).is_late() {
        return SolveReport::failed(SolveStatus::TimeLimit, 0);
    }
    let units = match ws.kept.prepare(problem, w.len()) {
        Ok(units) => units,
        Err(status) => return SolveReport::failed(status, 0),
    };
    ws.corrections.begin();
    ws.delta.clear();
    ws.delta.extend_from_slice(view.delta_free);
    ws.force.clear();
    ws.force.resize(lambda.len(), 0.0);
    ws.motion.clear();
    ws.motion.resize(w.len(), 0.0);
    let mut best = SolveReport::failed(SolveStatus::MaxIterations, 0);
    let (mut iterations, mut idle) = (0, 0);
    let corrected = view.blocks.iter().any(|block| !block.law.is_associated());
    let mut until = if corrected { Until::on_the_way(None, deadline) } else { Until { deadline, enough: 0.0 } };
    for _ in 0..if corrected { config.max_programs } else { 1 } {
        let given = ws.corrections.next(view, &ws.delta, |_| 1.0 / units.length);
        let solved = ws.kept.solve(problem, units, given, until, &mut ws.motion, &mut ws.force);
        iterations += ws.kept.iterations();
        if let Err(status) = solved {
            return SolveReport { status, iterations, ..best };
        }
        gaps(problem, &ws.motion, &mut ws.delta);
        release(view, &ws.delta, &mut ws.force);
        let residual = natural_map(view, scale, &ws.delta, &ws.force);
        if !residual.relative.is_finite() {
            return SolveReport { status: SolveStatus::NotFinite, iterations, ..best };
        }
        until = Until::on_the_way(Some(residual.relative), deadline);
        ws.corrections.note(residual.relative);
        idle = if residual.relative < NOTABLE * best.residual { 0 } else { idle + 1 };
        if residual.relative < best.residual {
            best.residual = residual.relative;
            best.worst_block = u32::try_from(residual.worst_block).unwrap_or(u32::MAX);
            best.worst_gap = residual.worst_gap;
            w.copy_from_slice(&ws.motion);
            lambda.copy_from_slice(&ws.force);
        }
        let out_of_time = watch.note(iterations, residual.relative);
        if best.residual <= config.tolerance {
            return SolveReport { status: SolveStatus::Solved, iterations, ..best };
        }
        if out_of_time {
            return SolveReport { status: SolveStatus::TimeLimit, iterations, ..best };
        }
        if idle >= STALL {
            return SolveReport { status: SolveStatus::Stalled, iterations, ..best };
        }
    }
    let status = if corrected { SolveStatus::MaxIterations } else { SolveStatus::Stalled };
    SolveReport { status, iterations, ..best }
}

/// `δ = δ_free + h H w`.
pub fn gaps(problem: &LagrangeProblem<'_>, w: &[f64], delta: &mut [f64]) {
    delta.copy_from_slice(problem.view.delta_free);
    for &(row, dof, value) in problem.jacobian {
        if let (Some(delta), Some(w)) = (delta.get_mut(row), w.get(dof)) {
            *delta += problem.dt * value * w;
        }
    }
}
