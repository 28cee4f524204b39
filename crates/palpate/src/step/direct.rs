//! The direct approaches of contact in a step: bodies and contacts solved together, without compliance.
//!
//! Free motion and `δ_free` are those of every step, so `w = v⁺ - v_free` is what a method finds, with `A w = h Hᵀ λ`.
//! The compliance is still computed, from the latest factor: the tick works from it, and so does the scale of the
//! residual. The residual itself is that of the gaps `δ_free + h H w`, which no approximation of `W` enters, or what is
//! left of that balance, `|A w - h Hᵀ λ|` relative to the greater of the two, where that is more.

use palpate_constraints::rows::ContactRows;
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::pcg::{PcgConfig, pcg};
use palpate_fem::sparse::SystemMatrix;
use palpate_solver::report::{SolveReport, SolveStatus};
use palpate_solver::residual::{natural_map, scale};

use super::coupled_system::{CoupledPreconditioner, CoupledSystem};
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
    /// Tissue and rigid bodies together, where there are rigid bodies.
    pub(super) coupled: Option<CoupledSystem>,
    /// `w` (m/s; rad/s): free nodes, then velocity and angular velocity of every rigid body.
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
        let bodies = world.bodies().rigid.len();
        let coupled = |joined| (bodies > 0).then(|| CoupledSystem::new(system, bodies, rows, joined));
        let (method, coupled) = match world.description().contact.method {
            ContactMethod::Compliance => return None,
            ContactMethod::Lagrange => {
                let coupled = coupled(false);
                let matrix = coupled.as_ref().map_or(system, |coupled| &coupled.matrix);
                (DirectMethod::Lagrange(Box::new(LagrangeStage::new(matrix))), coupled)
            }
            ContactMethod::Penalty => {
                let coupled = coupled(true);
                let matrix = coupled.as_ref().map_or(system, |coupled| &coupled.matrix);
                (DirectMethod::Penalty(Box::new(PenaltyStage::new(matrix, world.contact_capacity()))), coupled)
            }
        };
        let zeros = vec![0.0; CoupledSystem::freedoms(world.model().free_nodes(), bodies)];
        Some(Self {
            method,
            coupled,
            motion: zeros.clone(),
            load: zeros.clone(),
            carried: zeros,
            delta: Vec::with_capacity(rows),
        })
    }

    /// The motion of the tissue (m/s), three numbers a free node.
    pub(super) fn of_tissue(&self, tissue: usize) -> &[f64] {
        self.motion.get(..tissue).unwrap_or(&self.motion)
    }
}

/// `A` and `H` of all bodies.
pub(super) fn system_and_rows<'a>(
    coupled: Option<&'a CoupledSystem>,
    system: &'a SystemMatrix,
    rows: &'a ContactRows,
) -> (&'a SystemMatrix, &'a NodalRows) {
    coupled.map_or((system, &rows.tissue), |coupled| (&coupled.matrix, &coupled.rows))
}

/// Forces and motion of contact by the scene's direct approach; judges them on the natural map.
pub(super) fn direct_contact(
    world: &World,
    input: &StepInput<'_>,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    if let Some(DirectStage { coupled: Some(coupled), .. }) = &mut ws.direct {
        coupled.fill(&ws.fem.system, &ws.rigid.inverse, &ws.rows);
    }
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
    let Some(DirectStage { coupled, motion, load: pushes, .. }) = &mut ws.direct else { return };
    let body = &world.description().bodies[0];
    let (system, rows, memory) = match coupled {
        Some(CoupledSystem { matrix, rows, pcg, .. }) => (&*matrix, &*rows, pcg),
        None => (&ws.fem.system, &ws.rows.tissue, &mut ws.pcg),
    };
    load(rows, &ws.lambda[..rows.len()], ws.dt, pushes);
    let own = ws.own.as_ref().filter(|_| ws.own_is_current);
    let tissue = StepPreconditioner::new(own, input.factor, &ws.rotations, &mut ws.solve);
    let mut preconditioner = CoupledPreconditioner { tissue, rigid: &ws.rigid.inverse };
    let relative_tolerance = body.tolerance.min(world.description().solver.tolerance);
    let max_iterations = if ws.own_is_current { body.max_iterations } else { ws.iterations_left };
    let config = PcgConfig { relative_tolerance, max_iterations };
    let solve = pcg(system, pushes, motion, &mut preconditioner, config, memory);
    report.error.corrected(&solve);
}

/// `h Hᵀ λ`.
fn load(rows: &NodalRows, lambda: &[f64], dt: f64, load: &mut [f64]) {
    load.fill(0.0);
    rows.add_transposed(lambda, load);
    load.iter_mut().for_each(|f| *f *= dt);
}

/// What is left of `A w = h Hᵀ λ`, relative to the greater of its sides; zero where nothing moves and nothing pushes.
fn imbalance(tissue: &SystemMatrix, contacts: &ContactRows, lambda: &[f64], dt: f64, direct: &mut DirectStage) -> f64 {
    let DirectStage { coupled, motion, load: pushes, carried, .. } = direct;
    let (system, rows) = system_and_rows(coupled.as_ref(), tissue, contacts);
    load(rows, &lambda[..rows.len()], dt, pushes);
    system.multiply(motion, carried);
    let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let most = norm(pushes).max(norm(carried));
    carried.iter_mut().zip(pushes).for_each(|(carried, load)| *carried -= *load);
    if most == 0.0 { 0.0 } else { norm(carried) / most }
}

/// The report with the residual of motion and forces, solved only where these balance to the tolerance.
fn judge(found: SolveReport, tolerance: f64, ws: &mut StepWorkspace) -> SolveReport {
    let Some(direct) = &mut ws.direct else { return found };
    let (view, contacts) = (ws.problem.view(), &ws.rows);
    let (_, rows) = system_and_rows(direct.coupled.as_ref(), &ws.fem.system, contacts);
    direct.delta.clear();
    direct.delta.extend((0..rows.len()).map(|r| contacts.delta_free[r] + ws.dt * rows.dot(r, &direct.motion)));
    let Some(length) = scale(&view) else { return SolveReport { residual: 0.0, worst_gap: 0.0, ..found } };
    let left = natural_map(&view, length, &direct.delta, &ws.lambda[..contacts.len()]);
    let imbalance = imbalance(&ws.fem.system, contacts, &ws.lambda, ws.dt, direct);
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
