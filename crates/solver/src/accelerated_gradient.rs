//! Accelerated projected gradient with restart [Nesterov 1983; O'Donoghue and Candès 2015; Mazhar, Heyn, Negrut and
//! Tasora 2015].
//!
//! ```text
//! y       = lambda + beta (lambda - lambda of the iteration before)
//! lambda' = P( y - tau rho_a (corrected gap at y)_a )        block by block
//! ```
//!
//! `rho_a` scales each block to order one, whatever its stiffness. `tau` is halved until the step stays under the quadratic
//! bound `(lambda' - y)^T W (lambda' - y) <= |lambda' - y|^2 / (tau rho)`, and grows a little otherwise. Momentum starts
//! anew where it points against the gradient. Departure from the paper on friction: the corrected gap of De Saxcé takes
//! the place of the gradient of a relaxed (associated) problem, so that the fixed points are Coulomb's.
//!
//! One iteration costs one product with `W`: the gap at `y` follows by linearity. Needs many iterations, but none of them
//! solves anything, and rank-deficient `W` does not disturb it.

use crate::gauss_seidel::GaussSeidelWorkspace;
use crate::iteration::{self, Advance, Stop};
use crate::problem::{ProblemView, gather, scatter};
use crate::report::SolveReport;
use crate::solver::ConstraintSolver;
use crate::watch::Watch;
use serde::{Deserialize, Serialize};

/// Growth of `tau` in each iteration: halved steps are regained in about fifty.
const GROWTH: f64 = 1.015;

/// Halvings of `tau` in one iteration: enough for any finite `W` of the sizes that are accepted.
const MOST_HALVINGS: u32 = 40;

/// Parameters of the accelerated gradient method.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AcceleratedGradientConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of iterations. Default 20000.
    pub max_iterations: u32,
    /// Iterations without a fall of the residual by a hundredth after which the run ends as stalled. Default 2000.
    pub stall_iterations: u32,
}

impl Default for AcceleratedGradientConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 20_000, stall_iterations: 2000 }
    }
}

/// Memory of the accelerated gradient method.
#[derive(Clone, Debug, Default)]
pub struct AcceleratedGradientWorkspace {
    sweeps: GaussSeidelWorkspace,
    /// Forces and gap of the iteration before.
    before: [Vec<f64>; 2],
    /// Forces and gap at `y`.
    ahead: [Vec<f64>; 2],
}

/// What goes from one iteration to the next.
struct Momentum {
    tau: f64,
    theta: f64,
}

impl ConstraintSolver for AcceleratedGradientConfig {
    const NAME: &'static str = "accelerated_gradient";
    type Workspace = AcceleratedGradientWorkspace;

    fn workspace(&self, rows: usize) -> AcceleratedGradientWorkspace {
        let pair = || [Vec::with_capacity(rows), Vec::with_capacity(rows)];
        AcceleratedGradientWorkspace {
            sweeps: GaussSeidelWorkspace::with_capacity(rows),
            before: pair(),
            ahead: pair(),
        }
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_iterations: max_iterations.unwrap_or(self.max_iterations), ..self }
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut AcceleratedGradientWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop =
            Stop { tolerance: self.tolerance, max_iterations: self.max_iterations, stall: self.stall_iterations };
        let AcceleratedGradientWorkspace { sweeps, before, ahead } = ws;
        before.iter_mut().for_each(Vec::clear);
        let mut momentum = Momentum { tau: 1.0, theta: 1.0 };
        iteration::run(view, lambda, stop, sweeps, watch, |lambda, sweeps, _| {
            advance(view, lambda, sweeps, before, ahead, &mut momentum);
            Advance::Formed
        })
    }
}

fn advance(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    sweeps: &mut GaussSeidelWorkspace,
    [lambda_before, delta_before]: &mut [Vec<f64>; 2],
    [y, delta_y]: &mut [Vec<f64>; 2],
    momentum: &mut Momentum,
) {
    let theta = 0.5 * (1.0 + (1.0 + 4.0 * momentum.theta * momentum.theta).sqrt());
    let beta = if lambda_before.is_empty() { 0.0 } else { (momentum.theta - 1.0) / theta };
    momentum.theta = theta;
    extrapolate(lambda, lambda_before, beta, y);
    extrapolate(&sweeps.delta, delta_before, beta, delta_y);
    replace(lambda_before, lambda);
    replace(delta_before, &sweeps.delta);
    for _ in 0..MOST_HALVINGS {
        let mut length = 0.0;
        for (block, local) in view.blocks.iter().zip(&sweeps.local) {
            let at = gather(y, block);
            let gap = block.law.corrected_gap(&gather(delta_y, block));
            let new = block.law.project(&(at - gap * (momentum.tau * local.rho())));
            length += (new - at).norm_squared() / local.rho();
            scatter(&new, block, lambda);
        }
        view.gap(lambda, &mut sweeps.delta);
        let bend: f64 = (0..y.len()).map(|i| (lambda[i] - y[i]) * (sweeps.delta[i] - delta_y[i])).sum();
        if bend * momentum.tau <= length {
            break;
        }
        momentum.tau *= 0.5;
    }
    momentum.tau *= GROWTH;
    let against: f64 = view
        .blocks
        .iter()
        .zip(&sweeps.local)
        .map(|(block, local)| {
            let new = gather(lambda, block);
            (gather(y, block) - new).dot(&(new - gather(lambda_before, block))) / local.rho()
        })
        .sum();
    if against > 0.0 {
        momentum.theta = 1.0;
    }
}

/// `out = x + beta (x - before)`, within the capacity of `out`.
fn extrapolate(x: &[f64], before: &[f64], beta: f64, out: &mut Vec<f64>) {
    out.clear();
    if before.len() == x.len() {
        out.extend(x.iter().zip(before).map(|(x, before)| x + beta * (x - before)));
    } else {
        out.extend_from_slice(x);
    }
}

fn replace(old: &mut Vec<f64>, new: &[f64]) {
    old.clear();
    old.extend_from_slice(new);
}
