//! The direct approaches of contact in a step: body and contacts solved together, without compliance.
//!
//! Free motion and `δ_free` are those of every step, so `w = v⁺ - v_free` is what a method finds, with `A w = h Hᵀ λ`.
//! The compliance is still computed, from the latest factor: the tick works from it, and so does the scale of the
//! residual. The residual itself is that of the gaps `δ_free + h H w`, which no approximation of `W` enters, or what is
//! left of that balance, `|A w - h Hᵀ λ|` relative to the greater of the two, where that is more.

use palpate_constraints::rows::ContactRows;
use palpate_fem::pcg::{PcgConfig, pcg};
use palpate_fem::sparse::SystemMatrix;
use palpate_solver::report::{SolveReport, SolveStatus};
use palpate_solver::residual::{natural_map, scale};

use super::lagrange::{LagrangeStage, lagrange};
use super::penalty::{PenaltyStage, penalty};
use super::preconditioner::StepPreconditioner;
use super::{StepInput, StepReport, StepState, StepWorkspace};
use crate::scene::ContactMethod;
use crate::world::World;

/// Scratch of the method that the scene chose.
pub(super) enum DirectMethod {
    /// Lagrange multipliers.
    Lagrange(Box<LagrangeStage>),
    /// Springs and dampers.
    Penalty(Box<PenaltyStage>),
}

/// Scratch of a direct approach.
pub(super) struct DirectStage {
    pub(super) method: DirectMethod,
    /// `w` (m/s).
    pub(super) motion: Vec<f64>,
    /// `h Hᵀ λ`.
    load: Vec<f64>,
    /// `A w`.
    carried: Vec<f64>,
    /// Gaps at the end of the step (m).
    delta: Vec<f64>,
}

impl DirectStage {
    /// Memory for the scene's method; none for the indirect approach.
    pub(super) fn new(world: &World, system: &SystemMatrix, rows: usize) -> Option<Self> {
        let contacts = world.detection().max_contacts;
        let method = match world.description().contact.method {
            ContactMethod::Compliance => return None,
            ContactMethod::Lagrange => DirectMethod::Lagrange(Box::new(LagrangeStage::new(system))),
            ContactMethod::Penalty => DirectMethod::Penalty(Box::new(PenaltyStage::new(system, contacts))),
        };
        let zeros = vec![0.0; 3 * world.model().free_nodes()];
        Some(Self {
            method,
            motion: zeros.clone(),
            load: zeros.clone(),
            carried: zeros,
            delta: Vec::with_capacity(rows),
        })
    }
}

/// Forces and motion of contact by the scene's direct approach; judges them on the natural map.
pub(super) fn direct_contact(
    world: &World,
    input: &StepInput<'_>,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let found = match &mut ws.direct {
        None => return,
        Some(DirectStage { method: DirectMethod::Penalty(_), .. }) => penalty(world, input, state, ws),
        Some(DirectStage { method: DirectMethod::Lagrange(_), .. }) => {
            let found = lagrange(ws);
            balance(world, input, ws, report);
            found
        }
    };
    report.solve = judge(found, world.description().solver.tolerance, ws);
}

/// `A w = h Hᵀ λ` to the tolerance of the free motion, from the `w` that is there: a program leaves the balance to the size
/// of its own tolerance, which momentum would show.
fn balance(world: &World, input: &StepInput<'_>, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(direct) = &mut ws.direct else { return };
    let body = &world.description().bodies[0];
    load(&ws.rows, &ws.lambda, ws.dt, &mut direct.load);
    let own = ws.own.as_ref().filter(|_| ws.own_is_current);
    let mut preconditioner = StepPreconditioner::new(own, input.factor, &ws.rotations, &mut ws.solve);
    let relative_tolerance = body.tolerance.min(world.description().solver.tolerance);
    let max_iterations = if ws.own_is_current { body.max_iterations } else { ws.iterations_left };
    let config = PcgConfig { relative_tolerance, max_iterations };
    let solve = pcg(&ws.fem.system, &direct.load, &mut direct.motion, &mut preconditioner, config, &mut ws.pcg);
    report.error.corrected(&solve);
}

/// `h Hᵀ λ`.
fn load(rows: &ContactRows, lambda: &[f64], dt: f64, load: &mut [f64]) {
    load.fill(0.0);
    rows.tissue.add_transposed(&lambda[..rows.len()], load);
    load.iter_mut().for_each(|f| *f *= dt);
}

/// What is left of `A w = h Hᵀ λ`, relative to the greater of its sides; zero where nothing moves and nothing pushes.
fn imbalance(system: &SystemMatrix, rows: &ContactRows, lambda: &[f64], dt: f64, direct: &mut DirectStage) -> f64 {
    load(rows, lambda, dt, &mut direct.load);
    system.multiply(&direct.motion, &mut direct.carried);
    let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let most = norm(&direct.load).max(norm(&direct.carried));
    direct.carried.iter_mut().zip(&direct.load).for_each(|(carried, load)| *carried -= load);
    if most == 0.0 { 0.0 } else { norm(&direct.carried) / most }
}

/// The report with the residual of motion and forces, solved only where these balance to the tolerance.
fn judge(found: SolveReport, tolerance: f64, ws: &mut StepWorkspace) -> SolveReport {
    let Some(direct) = &mut ws.direct else { return found };
    let (view, rows) = (ws.problem.view(), &ws.rows);
    direct.delta.clear();
    direct.delta.extend((0..rows.len()).map(|r| rows.delta_free[r] + ws.dt * rows.tissue.dot(r, &direct.motion)));
    let Some(length) = scale(&view) else { return SolveReport { residual: 0.0, worst_gap: 0.0, ..found } };
    let left = natural_map(&view, length, &direct.delta, &ws.lambda[..rows.len()]);
    let imbalance = imbalance(&ws.fem.system, rows, &ws.lambda, ws.dt, direct);
    let finite = left.relative.is_finite() && imbalance.is_finite();
    if !finite {
        ws.lambda.fill(0.0);
        direct.motion.fill(0.0);
    }
    let status = match found.status {
        _ if !finite => SolveStatus::NotFinite,
        SolveStatus::Solved if imbalance > tolerance => SolveStatus::Stalled,
        status => status,
    };
    SolveReport {
        status,
        residual: if finite { left.relative.max(imbalance) } else { f64::INFINITY },
        worst_block: u32::try_from(left.worst_block).unwrap_or(u32::MAX),
        worst_gap: left.worst_gap,
        ..found
    }
}
