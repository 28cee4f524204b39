//! Nonsmooth nonlinear conjugate gradients [Silcowitz, Niebe and Erleben 2010]: Fletcher-Reeves on the change that a sweep
//! of block Gauss-Seidel makes.
//!
//! ```text
//! lambda' = sweep(lambda) ,  g = lambda - lambda'
//! beta = |g|^2 / |g of the iteration before|^2
//! beta <= 1:  lambda = P(lambda' + beta p) ,  p = beta p - g
//! beta >  1:  lambda = lambda' ,  p = -g
//! ```
//!
//! Departures: the norm is `sum_a |g_a|^2 / rho_a` (N m), so that stiff and soft contacts count alike; the forces after
//! the extra step are projected block by block, since they may have left their cones; and the gap follows by linearity
//! (`W p` is a combination of gaps already known), so that an iteration costs one sweep and O(m).

use crate::gauss_seidel::{GaussSeidelWorkspace, add_columns, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::problem::{ProblemView, gather, scatter};
use crate::report::SolveReport;
use crate::solver::ConstraintSolver;
use crate::watch::Watch;
use nalgebra::Vector3;
use palpate_constraints::law::LocalCompliance;
use serde::{Deserialize, Serialize};

/// Parameters of NNCG.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NncgConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of iterations, of one sweep each. Default 1000.
    pub max_iterations: u32,
    /// Iterations without a fall of the residual by a hundredth after which the run ends as stalled. Default 200.
    pub stall_iterations: u32,
}

impl Default for NncgConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 1000, stall_iterations: 200 }
    }
}

/// Memory of NNCG: that of Gauss-Seidel and `4 m` numbers.
#[derive(Clone, Debug, Default)]
pub struct NncgWorkspace {
    sweeps: GaussSeidelWorkspace,
    /// Forces before the sweep, N.
    lambda: Vec<f64>,
    /// Gap before the sweep, m.
    delta: Vec<f64>,
    /// Direction `p`, N.
    direction: Vec<f64>,
    /// `W p`, m.
    gap_direction: Vec<f64>,
}

impl ConstraintSolver for NncgConfig {
    const NAME: &'static str = "nncg";
    type Workspace = NncgWorkspace;

    fn workspace(&self, rows: usize) -> NncgWorkspace {
        let vector = || Vec::with_capacity(rows);
        NncgWorkspace {
            sweeps: GaussSeidelWorkspace::with_capacity(rows),
            lambda: vector(),
            delta: vector(),
            direction: vector(),
            gap_direction: vector(),
        }
    }

    fn limited(self, tolerance: f64, max_iterations: u32) -> Self {
        Self { tolerance, max_iterations, ..self }
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut NncgWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop =
            Stop { tolerance: self.tolerance, max_iterations: self.max_iterations, stall: self.stall_iterations };
        let NncgWorkspace { sweeps, lambda: before, delta: delta_before, direction, gap_direction } = ws;
        // Resized within their capacity: a problem that does not fit is refused before the first iteration.
        let rows = view.rows().min(sweeps.capacity());
        for vector in [&mut *before, delta_before, direction, gap_direction] {
            vector.clear();
            vector.resize(rows, 0.0);
        }
        let mut norm_before = 0.0;
        iteration::run(view, lambda, stop, sweeps, watch, |lambda, sweeps, _| {
            before.copy_from_slice(lambda);
            delta_before.copy_from_slice(&sweeps.delta);
            sweep(view, lambda, 1.0, false, sweeps);
            let norm = squared_change(view, before, lambda, &sweeps.local);
            let beta = if norm_before > 0.0 { norm / norm_before } else { f64::INFINITY };
            norm_before = norm;
            if beta <= 1.0 {
                extend(view, beta, [before, delta_before], [direction, gap_direction], lambda, sweeps);
            } else {
                // Begin anew: the next direction is the change of this sweep.
                for (p, (old, new)) in direction.iter_mut().zip(before.iter().zip(lambda.iter())) {
                    *p = new - old;
                }
                for (p, (old, new)) in gap_direction.iter_mut().zip(delta_before.iter().zip(&sweeps.delta)) {
                    *p = new - old;
                }
            }
            Advance::Updated
        })
    }
}

/// `sum_a |lambda'_a - lambda_a|^2 / rho_a`, N m.
fn squared_change(view: &ProblemView<'_>, old: &[f64], new: &[f64], local: &[LocalCompliance]) -> f64 {
    let share =
        |(block, local): (_, &LocalCompliance)| (gather(new, block) - gather(old, block)).norm_squared() / local.rho();
    view.blocks.iter().zip(local).map(share).sum()
}

/// `lambda += beta p`, projected, and `p = beta p + change of the sweep`; gaps along with them.
fn extend(
    view: &ProblemView<'_>,
    beta: f64,
    [before, delta_before]: [&[f64]; 2],
    [direction, gap_direction]: [&mut [f64]; 2],
    lambda: &mut [f64],
    ws: &mut GaussSeidelWorkspace,
) {
    for i in 0..direction.len().min(lambda.len()) {
        let change = lambda[i] - before[i];
        lambda[i] += beta * direction[i];
        direction[i] = beta * direction[i] + change;
    }
    for (i, gap) in ws.delta.iter_mut().enumerate().take(gap_direction.len()) {
        let change = *gap - delta_before[i];
        *gap += beta * gap_direction[i];
        gap_direction[i] = beta * gap_direction[i] + change;
    }
    for block in view.blocks {
        let force = gather(lambda, block);
        let nearest = block.law.project(&force);
        let correction = nearest - force;
        if correction != Vector3::zeros() {
            scatter(&nearest, block, lambda);
            add_columns(view, block, &correction, &mut ws.delta);
        }
    }
}
