//! Block Gauss-Seidel with an exact local solve [Duriez et al. 2006, algorithm 1; Jourdan, Alart and Jean 1998].
//!
//! ```text
//! delta = W lambda + delta_free
//! repeat: for each block a:
//!     b       = delta_a - W_aa lambda_a
//!     lambda' = exact local solution of (W_aa, b)
//!     delta  += W_{.,a} (lambda' - lambda_a) ;  lambda_a = lambda'
//! until natural-map residual <= tolerance
//! ```
//!
//! Departures from the paper: the local problem is solved exactly (the paper does one projected fixed-point step), forces
//! are warm-started, the gap of all rows is kept current by the columns of the changed forces (contiguous memory, nothing
//! for blocks that do not change), and so the residual costs O(m), is looked at after every sweep and replaces the change
//! of the forces as stopping test. `W` may be singular: a nearly singular `W_aa` is shifted, which moves no fixed point
//! (see [`LocalCompliance`]). With rows that conflict the forces would creep upwards sweep by sweep; the run then ends as
//! [`SolveStatus::Stalled`] with the best iterate.
//!
//! Work is bounded by `max_sweeps`, memory is the workspace's, and `lambda` is finite and inside its cones at the end of
//! every sweep.

use crate::iteration::{self, Advance, Stop};
use crate::problem::{Block, ProblemView, gather, scatter};
use crate::report::{SolveReport, SolveStatus};
use crate::residual::{Residual, natural_map_scaled};
use crate::solver::ConstraintSolver;
use crate::vectors::add_columns;
use crate::watch::Watch;
use nalgebra::Vector3;
use palpate_constraints::law::LocalCompliance;
use serde::{Deserialize, Serialize};

/// Order in which a sweep visits the blocks.
///
/// Sweeps to 1e-8 on the frictional contacts of a ball in the liver (`cargo bench --bench solver`), for 10, 30, 60 and 150
/// contacts: forward 30, 42, 60, 62; shuffled 44, 54, 63, 79; symmetric 74, 158, 336, 516. Forward is the default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SweepOrder {
    /// First to last.
    #[default]
    Forward,
    /// First to last and last to first in turn: an early stop favours neither end.
    Symmetric,
    /// A new order in every sweep, the same in every run.
    Shuffled,
}

impl SweepOrder {
    /// All orders.
    pub const ALL: [Self; 3] = [Self::Forward, Self::Symmetric, Self::Shuffled];

    /// Name in scenes and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Forward => "forward",
            Self::Symmetric => "symmetric",
            Self::Shuffled => "shuffled",
        }
    }
}

/// Parameters of block Gauss-Seidel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GaussSeidelConfig {
    /// Natural-map residual to reach, relative, `> 0`: see [`crate::residual`]. Default 1e-6.
    pub tolerance: f64,
    /// Limit of sweeps. Default 1000.
    pub max_sweeps: u32,
    /// Part of each local change that is taken, in (0, 1]: 1 is the plain method, less damps cycling of strongly
    /// coupled frictional blocks at the price of more sweeps (0.8 in the cases of [`SweepOrder`]: 47, 54, 65, 73). Default
    /// 1.
    pub relaxation: f64,
    /// Order of the blocks. Default forward.
    pub order: SweepOrder,
    /// Sweeps without a fall of the residual by a hundredth after which the run ends as stalled. Default 200.
    pub stall_sweeps: u32,
}

impl Default for GaussSeidelConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_sweeps: 1000, relaxation: 1.0, order: SweepOrder::Forward, stall_sweeps: 200 }
    }
}

/// Memory of block Gauss-Seidel: `2 m` numbers and the diagonal blocks.
#[derive(Clone, Debug, Default)]
pub struct GaussSeidelWorkspace {
    /// Gap of all rows at the current forces, m.
    pub(crate) delta: Vec<f64>,
    /// Forces with the smallest residual so far, N.
    pub(crate) best: Vec<f64>,
    /// Diagonal blocks.
    pub(crate) local: Vec<LocalCompliance>,
    /// Order of a shuffled sweep.
    order: Vec<usize>,
    capacity: usize,
}

impl GaussSeidelWorkspace {
    /// Memory for problems of up to `rows` rows.
    #[must_use]
    pub fn with_capacity(rows: usize) -> Self {
        Self {
            delta: Vec::with_capacity(rows),
            best: Vec::with_capacity(rows),
            local: Vec::with_capacity(rows),
            order: Vec::with_capacity(rows),
            capacity: rows,
        }
    }

    /// Rows there is room for.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Gap (m) at the forces that the last call of [`prepare`], [`sweep`] or [`solve`] left; empty after a failure.
    #[must_use]
    pub fn delta(&self) -> &[f64] {
        &self.delta
    }

    /// Whether the workspace was prepared for problems of this size.
    fn fits(&self, view: &ProblemView<'_>, lambda: &[f64]) -> bool {
        self.delta.len() == view.rows() && lambda.len() == view.rows() && self.local.len() == view.blocks.len()
    }
}

/// Makes `lambda` (N) admissible, and forms the gap and the local factors. Must precede [`sweep`] whenever the problem
/// has changed. O(m²) for the gap; forces that are zero cost nothing.
///
/// # Errors
/// [`SolveStatus::Invalid`] or [`SolveStatus::CapacityExceeded`]; `lambda` is then zero.
pub fn prepare(view: &ProblemView<'_>, lambda: &mut [f64], ws: &mut GaussSeidelWorkspace) -> Result<(), SolveStatus> {
    ws.delta.clear();
    ws.local.clear();
    let status = if lambda.len() != view.rows() || !view.is_consistent() {
        SolveStatus::Invalid
    } else if view.rows() > ws.capacity {
        SolveStatus::CapacityExceeded
    } else {
        for block in view.blocks {
            scatter(&block.law.project(&gather(lambda, block)), block, lambda);
            ws.local.push(LocalCompliance::new(&view.diagonal_block(block), block.law.rows()));
        }
        ws.delta.resize(view.rows(), 0.0);
        view.gap(lambda, &mut ws.delta);
        return Ok(());
    };
    lambda.fill(0.0);
    Err(status)
}

/// One sweep over all blocks, first to last or `backward`. `relaxation` in (0, 1].
///
/// Returns `false`, and does nothing, where `ws` was not prepared for this problem.
pub fn sweep(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    relaxation: f64,
    backward: bool,
    ws: &mut GaussSeidelWorkspace,
) -> bool {
    if !ws.fits(view, lambda) {
        return false;
    }
    let GaussSeidelWorkspace { delta, local, .. } = ws;
    let blocks = view.blocks.iter().zip(local.iter());
    if backward {
        blocks.rev().for_each(|(block, local)| relax(view, block, local, relaxation, lambda, delta));
    } else {
        blocks.for_each(|(block, local)| relax(view, block, local, relaxation, lambda, delta));
    }
    true
}

/// One sweep in the order that belongs to `number`: Fisher-Yates with the numbers of a xorshift generator [Marsaglia
/// 2003].
fn shuffled_sweep(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    relaxation: f64,
    number: u32,
    ws: &mut GaussSeidelWorkspace,
) -> bool {
    if !ws.fits(view, lambda) {
        return false;
    }
    let GaussSeidelWorkspace { delta, local, order, .. } = ws;
    order.clear();
    order.extend(0..view.blocks.len());
    let mut state = (u64::from(number) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for last in (1..order.len()).rev() {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        order.swap(last, (state % (last as u64 + 1)) as usize);
    }
    for &a in order.iter() {
        if let (Some(block), Some(local)) = (view.blocks.get(a), local.get(a)) {
            relax(view, block, local, relaxation, lambda, delta);
        }
    }
    true
}

/// Residual of the current forces, from the running gap: O(m). `scale` in m from [`crate::residual::scale`].
#[must_use]
pub fn residual(view: &ProblemView<'_>, lambda: &[f64], scale: f64, ws: &GaussSeidelWorkspace) -> Residual {
    let rho = |a: usize| ws.local.get(a).map_or(1.0, LocalCompliance::rho);
    natural_map_scaled(view, scale, rho, &ws.delta, lambda)
}

/// Solves from the forces in `lambda` (N; zeros for a cold start) and leaves the answer there.
pub fn solve(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    config: &GaussSeidelConfig,
    ws: &mut GaussSeidelWorkspace,
) -> SolveReport {
    config.solve_watched(view, lambda, ws, &mut Watch::none())
}

impl ConstraintSolver for GaussSeidelConfig {
    const NAME: &'static str = "gauss_seidel";
    type Workspace = GaussSeidelWorkspace;

    fn workspace(&self, rows: usize) -> GaussSeidelWorkspace {
        GaussSeidelWorkspace::with_capacity(rows)
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_sweeps: max_iterations.unwrap_or(self.max_sweeps), ..self }
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut GaussSeidelWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop = Stop { tolerance: self.tolerance, max_iterations: self.max_sweeps, stall: self.stall_sweeps };
        let mut sweeps = 0_u32;
        iteration::run(view, lambda, stop, ws, watch, |lambda, ws, _| {
            match self.order {
                SweepOrder::Forward => sweep(view, lambda, self.relaxation, false, ws),
                SweepOrder::Symmetric => sweep(view, lambda, self.relaxation, sweeps % 2 == 1, ws),
                SweepOrder::Shuffled => shuffled_sweep(view, lambda, self.relaxation, sweeps, ws),
            };
            sweeps += 1;
            Advance::Updated
        })
    }
}

/// Solves one block and brings the gap of all rows up to date.
#[inline]
fn relax(
    view: &ProblemView<'_>,
    block: &Block,
    local: &LocalCompliance,
    relaxation: f64,
    lambda: &mut [f64],
    delta: &mut [f64],
) {
    let old = gather(lambda, block);
    let b = gather(delta, block) - local.gap(&old);
    let mut new = block.law.resolve_from(local, &b, &old);
    if relaxation != 1.0 {
        // Both are admissible and the set of admissible forces is convex; the projection only takes off rounding.
        new = block.law.project(&(old + (new - old) * relaxation));
    }
    let change = new - old;
    if change != Vector3::zeros() {
        scatter(&new, block, lambda);
        add_columns(view, block, &change, delta);
    }
}
