//! Nonsmooth nonlinear conjugate gradients [Silcowitz, Niebe and Erleben 2010]: Fletcher-Reeves on the change that a sweep
//! of block Gauss-Seidel makes.
//!
//! ```text
//! lambda' = sweep(lambda) ,  g = lambda - lambda'
//! beta = |g|^2 / |g of the iteration before|^2
//! beta <= 1:  lambda = P(lambda' + beta p)
//! beta >  1:  lambda = lambda'
//! p = lambda - lambda of the iteration before
//! ```
//!
//! Departures: the norm is `sum_a |g_a|^2 / rho_a` (N m), so that stiff and soft contacts count alike; the forces after
//! the extra step are projected block by block, since they may have left their cones, and `p` is the step that was
//! really made; an extra step that does not lower the natural-map residual is taken back, without which friction makes
//! the method wander at 1e-2; and the gap follows by linearity (`W p` is the change of the gap), so that an iteration
//! costs one sweep and O(m).

use crate::gauss_seidel::{GaussSeidelWorkspace, residual, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::problem::{ProblemView, gather, scatter};
use crate::report::SolveReport;
use crate::solver::ConstraintSolver;
use crate::vectors::add_columns;
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

/// Memory of NNCG: that of Gauss-Seidel and `6 m` numbers.
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
    /// Forces after the sweep, N.
    swept: Vec<f64>,
    /// Gap after the sweep, m.
    delta_swept: Vec<f64>,
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
            swept: vector(),
            delta_swept: vector(),
        }
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_iterations: max_iterations.unwrap_or(self.max_iterations), ..self }
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
        let NncgWorkspace { sweeps, lambda: before, delta: delta_before, direction, gap_direction, swept, delta_swept } =
            ws;
        // Resized within their capacity: a problem that does not fit is refused before the first iteration.
        let rows = view.rows().min(sweeps.capacity());
        for vector in [&mut *before, delta_before, direction, gap_direction, swept, delta_swept] {
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
                swept.copy_from_slice(lambda);
                delta_swept.copy_from_slice(&sweeps.delta);
                let plain = residual(view, lambda, 1.0, sweeps).relative;
                extend(view, beta, direction, gap_direction, lambda, sweeps);
                // False for NaN.
                let lowered = residual(view, lambda, 1.0, sweeps).relative <= plain;
                if !lowered {
                    lambda.copy_from_slice(swept);
                    sweeps.delta.copy_from_slice(delta_swept);
                }
            }
            difference(lambda, before, direction);
            difference(&sweeps.delta, delta_before, gap_direction);
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

/// `lambda += beta p`, projected, and the gap along with it.
fn extend(
    view: &ProblemView<'_>,
    beta: f64,
    direction: &[f64],
    gap_direction: &[f64],
    lambda: &mut [f64],
    ws: &mut GaussSeidelWorkspace,
) {
    lambda.iter_mut().zip(direction).for_each(|(force, p)| *force += beta * p);
    ws.delta.iter_mut().zip(gap_direction).for_each(|(gap, p)| *gap += beta * p);
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

/// `out = new - old`.
fn difference(new: &[f64], old: &[f64], out: &mut [f64]) {
    out.iter_mut().zip(new.iter().zip(old)).for_each(|(out, (new, old))| *out = new - old);
}
