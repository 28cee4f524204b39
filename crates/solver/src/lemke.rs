//! Lemke's method with lexicographic ratio test [Lemke 1965; Cottle, Pang and Stone 1992, algorithms 4.4.5 and 4.9.3] on the
//! linear complementarity problem of faceted cones.
//!
//! ```text
//! w = M z + q + e z_0 ,   one complementary pair outside the basis at a time, until z_0 leaves it
//! ```
//!
//! It needs no symmetric `W`. Degenerate ratios (redundant rows, equal contacts) are told apart by the rows of the inverse
//! basis, so that it cannot cycle. Where it ends on a ray, a positive semidefinite problem has no solution; an indefinite
//! one may.
//!
//! Friction on the exact cone is reached by turning the polygons: after each solution the first corner of a contact's
//! polygon is turned halfway to its friction (against the slip where it slides) and the problem is solved anew. At the fixed
//! point the corner carries the force, and the polygon no longer shows. Pivoting always ends with a solution of the faceted
//! problem where `W` is positive semidefinite, but the headings need not settle where many contacts slide at once: a corner
//! jumps to its neighbour and back. What is left is the error of the polygon, up to `1 - cos(pi / k)` of the friction's size and
//! `pi / k` of its direction with `k` facets; a tolerance of 1e-6 would take facets by the thousand. So, once
//! [`UNSETTLED`] turns have not lowered the residual, sweeps of block Gauss-Seidel on the exact cone take off the rest; a run
//! whose sweeps do not end either is stalled, with the residual on the exact cone.
//! [`FacetedCoulomb`](palpate_constraints::law::FacetedCoulomb) is solved as it is.
//!
//! More corners do not spare sweeps, since those follow anyway: on 30 contacts pressed into the liver or a slab, to 1e-6, polygons
//! of 4, 8, 16 and 32 corners take 10 to 115, 110 to 370, 440 to 960 and 2500 to 7200 ms, and 7 to 38 turns and sweeps each. Corners
//! chosen from the tolerance, `1 - cos(pi / k)`, would be 70 for 1e-3.
//!
//! One pivot costs `O(n^2)`, with `n` = 6 per frictional contact at 4 facets: a reference and a fall-back, for tens of
//! contacts. Memory is that of polygons with `facets` corners on every contact; a problem whose own laws have more facets makes
//! it grow, once.

use crate::complementarity::Complementarity;
use crate::gauss_seidel::{GaussSeidelWorkspace, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::problem::{ProblemView, gather, scatter};
use crate::report::{SolveReport, SolveStatus};
use crate::solver::ConstraintSolver;
use crate::tableau::Tableau;
use crate::watch::Watch;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Largest number of variables; the tableau then takes 0.27 GB.
pub const MAX_VARIABLES: usize = 4096;

/// Turns without a fall of the residual by a tenth after which the polygons are taken not to settle.
pub const UNSETTLED: u32 = 3;

/// Slip below this part of the largest gap is sticking.
const SLIP_FLOOR: f64 = 1e-10;

/// Iterations without a fall of the residual by a hundredth after which a run has stalled.
const STALL: u32 = 200;

/// Parameters of Lemke's method.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LemkeConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of solutions with turned polygons and of sweeps after them, in all. Default 1000.
    pub max_iterations: u32,
    /// Corners of the friction polygon where the law leaves them open, 3 or more. Default 4.
    pub facets: usize,
    /// Limit of pivots of one solution, for each variable: 20 are far more than a sound problem takes. Default 20.
    pub pivots_per_variable: usize,
}

impl Default for LemkeConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 1000, facets: 4, pivots_per_variable: 20 }
    }
}

/// Memory of Lemke's method: a tableau of `2 n (n + 1)` numbers for up to `n` variables.
#[derive(Clone, Debug)]
pub struct LemkeWorkspace {
    pub(crate) sweeps: GaussSeidelWorkspace,
    problem: Complementarity,
    tableau: Tableau,
    /// Direction of the first corner of each block's polygon, rad.
    heading: Vec<f64>,
}

impl ConstraintSolver for LemkeConfig {
    const NAME: &'static str = "lemke";
    type Workspace = LemkeWorkspace;

    fn workspace(&self, rows: usize) -> LemkeWorkspace {
        // Six more for the room that laying out a block asks for.
        let variables = rows.saturating_mul(self.facets.max(4) + 2).div_ceil(3).min(MAX_VARIABLES) + 6;
        LemkeWorkspace {
            sweeps: GaussSeidelWorkspace::with_capacity(rows),
            problem: Complementarity::with_capacity(variables, rows),
            tableau: Tableau::with_capacity(variables),
            heading: Vec::with_capacity(rows),
        }
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_iterations: max_iterations.unwrap_or(self.max_iterations), ..self }
    }

    fn prepare(&self, view: &ProblemView<'_>, ws: &mut LemkeWorkspace) -> Result<(), SolveStatus> {
        if view.rows() > ws.sweeps.capacity() {
            return Err(SolveStatus::CapacityExceeded);
        }
        ws.tableau.reserve(ws.problem.reserve(view, self.facets.max(3), MAX_VARIABLES));
        Ok(())
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut LemkeWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop = Stop { tolerance: self.tolerance, max_iterations: self.max_iterations, stall: STALL };
        let LemkeWorkspace { sweeps, problem, tableau, heading } = ws;
        heading.clear();
        heading.resize(view.blocks.len().min(sweeps.capacity()), 0.0);
        let deadline = watch.deadline();
        let (mut least, mut unsettled, mut first, mut pivoted) = (f64::INFINITY, 0, true, false);
        iteration::run(view, lambda, stop, sweeps, watch, |lambda, sweeps, residual| {
            // The residual of the start is none of the polygons'.
            if !first && unsettled < UNSETTLED {
                unsettled = if residual < 0.9 * least { 0 } else { unsettled + 1 };
                least = least.min(residual);
            }
            // The start is as good as its forces: its friction tells where the polygons should point.
            let settled = unsettled >= UNSETTLED
                || !turn(view, lambda, &sweeps.delta, PI / self.facets.max(3) as f64, heading) && !first;
            if settled {
                unsettled = UNSETTLED;
                sweep(view, lambda, 1.0, false, sweeps);
                return Advance::Updated;
            }
            first = false;
            tableau.reserve(problem.reserve(view, self.facets.max(3), MAX_VARIABLES));
            if !problem.lay_out(view, self.facets.max(3), heading) || !tableau.reset(problem.len()) {
                return Advance::Ended(SolveStatus::CapacityExceeded);
            }
            problem.fill(view, &sweeps.local, &mut tableau.numbers);
            let most = self.pivots_per_variable.saturating_mul(problem.len()).max(100);
            match tableau.solve(most, deadline) {
                // Polygons that were turned only a little have a solution as those before; it was lost to rounding.
                Err(SolveStatus::NoSolution) if pivoted => {
                    unsettled = UNSETTLED;
                    sweep(view, lambda, 1.0, false, sweeps);
                    return Advance::Updated;
                }
                Err(status) => return Advance::Ended(status),
                Ok(()) => pivoted = true,
            }
            lambda.fill(0.0);
            tableau.values(|j, z| problem.add_force(view, &sweeps.local, j, z, lambda));
            for block in view.blocks {
                scatter(&block.law.project(&gather(lambda, block)), block, lambda);
            }
            view.gap(lambda, &mut sweeps.delta);
            Advance::Formed
        })
    }
}

/// Lays the first corner of each polygon along the friction; whether a heading has changed.
fn turn(view: &ProblemView<'_>, lambda: &[f64], delta: &[f64], sector: f64, heading: &mut [f64]) -> bool {
    let largest = view.delta_free.iter().fold(0.0_f64, |largest, gap| largest.max(gap.abs()));
    let mut turned = false;
    for (block, heading) in view.blocks.iter().zip(heading) {
        let (force, slip) = (gather(lambda, block).yz(), -gather(delta, block).yz());
        let along = if slip.norm() > SLIP_FLOOR * largest { slip } else { force };
        if along.norm() > 0.0 {
            // Half of the way, by the shorter side: the whole way flips between two headings where friction is strong.
            let way = (along.y.atan2(along.x) - *heading + PI).rem_euclid(TAU) - PI;
            turned |= way != 0.0;
            *heading += if way.abs() > sector { way } else { 0.5 * way };
        }
    }
    turned
}
