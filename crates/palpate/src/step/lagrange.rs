//! Contact by Lagrange multipliers over all bodies; see [`palpate_solver::lagrange`]. It allocates where the
//! contacts touch other nodes than in the step before.
//!
//! A step has no limit of time, here as for every other solver: where it met one would hang on the load of the machine, and
//! a recorded run would not replay to the bit. Its work is bounded by the limit of programs.

use palpate_fem::sparse::SystemMatrix;
use palpate_solver::lagrange::{LagrangeConfig, LagrangeProblem, LagrangeWorkspace, solve};
use palpate_solver::report::SolveReport;

use super::StepWorkspace;
use super::direct::{DirectMethod, DirectStage, system_and_rows};
use super::forces::NOT_SOLVED;

/// The system matrix as Clarabel takes it: the upper triangle by columns.
pub(super) struct LagrangeStage {
    column_start: Vec<usize>,
    row: Vec<usize>,
    value: Vec<f64>,
    /// Place of each entry in the system matrix: block, row, column.
    source: Vec<(usize, usize, usize)>,
    jacobian: Vec<(usize, usize, f64)>,
    program: LagrangeWorkspace,
}

impl LagrangeStage {
    pub(super) fn new(system: &SystemMatrix) -> Self {
        let pattern = &system.pattern;
        let (mut column_start, mut row, mut source) = (vec![0], Vec::new(), Vec::new());
        for j in 0..pattern.rows() {
            for column in 0..3 {
                // Column `j` of the symmetric matrix holds the nodes of row `j`, in ascending order.
                for p in pattern.row(j) {
                    let i = pattern.columns()[p] as usize;
                    for r in (0..3).filter(|r| 3 * i + r <= 3 * j + column) {
                        row.push(3 * i + r);
                        // Block (j, i) is the transpose of block (i, j).
                        source.push((p, column, r));
                    }
                }
                column_start.push(row.len());
            }
        }
        Self {
            value: vec![0.0; row.len()],
            column_start,
            row,
            source,
            jacobian: Vec::new(),
            program: LagrangeWorkspace::default(),
        }
    }
}

/// Forces into `ws.lambda`, motion into the stage; programs as many as the scene's solver may take iterations.
pub(super) fn lagrange(ws: &mut StepWorkspace) -> SolveReport {
    let (m, limits) = (ws.rows.len(), ws.limits);
    let Some(DirectStage { method: DirectMethod::Lagrange(stage), coupled, motion, .. }) = &mut ws.direct else {
        return NOT_SOLVED;
    };
    let (system, rows) = system_and_rows(coupled.as_ref(), &ws.fem.system, &ws.rows);
    for (value, &(block, r, c)) in stage.value.iter_mut().zip(&stage.source) {
        *value = system.blocks[block][(r, c)];
    }
    stage.jacobian.clear();
    for r in 0..m {
        for (node, value) in rows.row(r) {
            stage.jacobian.extend((0..3).map(|c| (r, 3 * node as usize + c, value[c])).filter(|e| e.2 != 0.0));
        }
    }
    let problem = LagrangeProblem {
        column_start: &stage.column_start,
        row: &stage.row,
        value: &stage.value,
        jacobian: &stage.jacobian,
        dt: ws.dt,
        view: ws.problem.view(),
    };
    let config = LagrangeConfig { tolerance: limits.0, max_programs: limits.1 };
    solve(&problem, &config, motion, &mut ws.lambda[..m], &mut stage.program)
}
