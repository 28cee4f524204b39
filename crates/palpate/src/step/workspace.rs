//! Workspace of the step: what may be thrown away.

use nalgebra::{Matrix3, Vector3};
use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::detection::DetectionWorkspace;
use palpate_constraints::compliance::ComplianceWorkspace;
use palpate_constraints::lumped::LumpedInverse;
use palpate_constraints::precomputed::PrecomputedWorkspace;
use palpate_constraints::rows::ContactRows;
use palpate_fem::assembly::{FemWorkspace, Windings};
use palpate_fem::factor::{Factor, ReachWorkspace, SolveWorkspace, SymbolicFactor};
use palpate_fem::integrator::explicit::ExplicitWorkspace;
use palpate_fem::integrator::newton::ImplicitWorkspace;
use palpate_fem::model::{FemModel, FemState};
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::pcg::PcgWorkspace;
use palpate_solver::automatic::AutomaticConfig;
use palpate_solver::problem::ConstraintProblem;
use palpate_solver::solver::{Solver, SolverWorkspace};
use std::sync::Arc;
use std::time::Instant;

use super::bodies::{self, PairForce};
use super::change::ChangeStage;
use super::climb::probe_room;
use super::direct::DirectStage;
use super::first_inverse::FirstInverse;
use super::obstacles::ObstacleStage;
use super::patch::PatchStage;
use super::refinement::RefinementWorkspace;
use super::rigid::RigidStage;
use crate::problem_files::ProblemFiles;
use crate::refresh::FactorSample;
use crate::world::{Integration, World};

/// Rows of a contact with friction.
pub(super) const ROWS: usize = 3;

/// Directions that the conjugate gradients of a step share: free motion, correction, refinement, compared column.
const KEPT_DIRECTIONS: usize = 12;

/// Scratch of steps by Newton's method.
pub(super) struct NewtonStage {
    pub(super) ws: ImplicitWorkspace,
    /// Where the free motion leads.
    pub(super) free: FemState,
    /// Whether the factor of the end of the free motion serves this step.
    pub(super) factored: bool,
    /// Contact forces that the motion already carries (N), one per row.
    pub(super) carried: Vec<f64>,
    /// The same on the free nodes, and on all nodes of the mesh.
    pub(super) free_load: Vec<f64>,
    pub(super) load: Vec<Vector3<f64>>,
}

impl NewtonStage {
    fn new(model: &FemModel, symbolic: &Arc<SymbolicFactor>, rows: usize) -> Self {
        Self {
            ws: ImplicitWorkspace::new(model, symbolic),
            free: model.rest_state(),
            factored: false,
            carried: vec![0.0; rows],
            free_load: vec![0.0; 3 * model.free_nodes()],
            load: vec![Vector3::zeros(); model.nodes()],
        }
    }
}

/// Scratch of explicit substeps.
pub(super) struct ExplicitStage {
    pub(super) ws: ExplicitWorkspace,
    pub(super) inverse: LumpedInverse,
    pub(super) compliance: ComplianceWorkspace<NodalRows>,
}

impl ExplicitStage {
    /// Memory for substeps `dt` (s): the system matrix is `M (1 + αh/2)`.
    fn new(model: &FemModel, dt: f64, rows: usize) -> Self {
        let damping = 1.0 + 0.5 * dt * model.rayleigh_mass();
        Self {
            ws: ExplicitWorkspace::new(model),
            inverse: LumpedInverse::new(model.node_of_free().iter().map(|&n| model.mass()[n as usize] * damping)),
            // A row touches three nodes at most.
            compliance: ComplianceWorkspace::new(rows, NodalRows::with_capacity(rows, 3)),
        }
    }
}

/// Scratch of the step, sized at set-up.
pub struct StepWorkspace {
    /// Forces, matrix, right side.
    pub fem: FemWorkspace,
    pub(super) rotations: Vec<Matrix3<f64>>,
    pub(super) pcg: PcgWorkspace,
    pub(super) solve: SolveWorkspace,
    /// Free velocity `v + dv` of the free nodes (m/s).
    pub(super) v_free: Vec<f64>,
    /// Whether the exact correction is to find the rest of the free motion, and what that has left of its right side.
    pub(super) carries: bool,
    pub(super) carried: Vec<f64>,
    /// `h A⁻¹ Hᵀ lambda` (m/s).
    pub(super) correction: Vec<f64>,
    pub(super) geometry: SurfaceGeometry,
    pub(super) detection: DetectionWorkspace,
    pub(super) rows: ContactRows,
    /// Rows of contacts on fixed skin, which only the tick can give a force: there the tool yields.
    pub(super) fixed_rows: ContactRows,
    /// The same at fixed bodies.
    pub(super) obstacles: ObstacleStage,
    pub(super) compliance: ComplianceWorkspace<PrecomputedWorkspace>,
    /// The inverse of the first matrix, where the plan wants it.
    pub(super) first: Option<FirstInverse>,
    /// What another rung of the ladder would have answered.
    pub(super) probe: Vec<f64>,
    pub(super) problem: ConstraintProblem,
    pub(super) lambda: Vec<f64>,
    /// Rigid bodies, and the blocks of each pair of bodies.
    pub(super) rigid: RigidStage,
    /// The scene's solver at step rate, and its memory.
    pub(super) solver: Solver,
    pub(super) solver_workspace: SolverWorkspace,
    /// Tolerance and limit of iterations of the solve at step rate.
    pub(super) limits: (f64, u32),
    /// The direct approach of contact, where the scene wants one.
    pub(super) direct: Option<DirectStage>,
    /// Factor of this step's own matrix, where the plan may want one.
    pub(super) own: Option<Factor>,
    /// Whether `own` is that of the step at hand.
    pub(super) own_is_current: bool,
    /// What is left of the iterations of the step at hand.
    pub(super) iterations_left: usize,
    /// Right side and solution of solves besides the free motion.
    pub(super) load: Vec<f64>,
    pub(super) sample: Vec<f64>,
    /// The unit force whose column is compared.
    pub(super) lambda_of_sample: Vec<f64>,
    /// When the next step is due; none where time is virtual.
    pub(super) end: Option<Instant>,
    /// What a second solve for the forces starts from.
    pub(super) refinement: RefinementWorkspace,
    /// Newton's method, where it integrates.
    pub(super) newton: Option<NewtonStage>,
    /// Central differences, where they integrate.
    pub(super) explicit: Option<ExplicitStage>,
    /// The step that the stages take: the scene's, or a substep of it (s).
    pub(super) dt: f64,
    /// The tissue around the tool, where the tick wants it.
    pub(super) patch: Option<PatchStage>,
    /// Configurations that the guard tries.
    pub(super) trial: FemState,
    /// Newton's method for tissue in trouble.
    pub(super) rescue: Option<ImplicitWorkspace>,
    /// How the tissue winds round its edges, where it is guarded.
    pub(super) windings: Option<Windings>,
    /// Diagonal of the body at rest (m).
    pub(super) size: f64,
    /// Passing from one body to the next.
    pub(super) change: ChangeStage,
    /// Where the problems go that are solved, if they are kept.
    pub(crate) problem_files: Option<ProblemFiles>,
}

impl StepWorkspace {
    /// Contact forces of the last step (N), one per row.
    pub fn forces(&self) -> &[f64] {
        self.lambda.get(..self.rows.len()).unwrap_or(&[])
    }

    /// Motion of the free nodes by the contact forces of the last step in contact, `Δv = h A⁻¹ Hᵀ λ` (m/s).
    pub fn correction(&self) -> &[f64] {
        &self.correction
    }

    /// When the steps after this call are to be done: what they measure of themselves and do not need is left out where
    /// there is no time for it. Without this they take what time they need, and are the same on every machine.
    pub fn end_by(&mut self, end: Instant) {
        self.end = Some(end);
    }

    /// Rows of the last step that belong to the tool: the first of all.
    pub(super) fn tool_rows(&self) -> usize {
        self.rigid.tool_blocks.checked_sub(1).and_then(|last| self.rows.blocks.get(last)).map_or(0, |b| b.range().end)
    }

    /// Rows of the last step, those of the tool first.
    pub fn rows(&self) -> &ContactRows {
        &self.rows
    }

    /// What the contacts of pair `k` of [`Bodies::pairs`](crate::world::Bodies::pairs) did in the last step.
    pub fn pair_force(&self, k: usize) -> Option<PairForce> {
        bodies::pair_force(self, k)
    }

    /// The contact problem of the last step.
    pub fn problem(&self) -> &ConstraintProblem {
        &self.problem
    }

    /// Precomputes what the plan wants of the first factor; called with it before the first step.
    #[doc(hidden)]
    pub fn precompute(&mut self, world: &World, first: &FactorSample) {
        self.first = FirstInverse::new(world, first, &mut self.compliance);
    }

    /// Memory for the world's body and its largest number of contacts.
    pub fn new(world: &World) -> Self {
        let (model, symbolic) = (world.model(), world.symbolic());
        let free = model.free_nodes();
        let contacts = world.contact_capacity();
        let rows = ROWS * contacts;
        let patch_nodes = world.patch_nodes();
        // A patch, and the rows that are held while the tool touches it.
        let others = rows - ROWS * world.detection().max_contacts;
        let places = patch_nodes + world.yielding_contacts();
        let compliance_rows = rows.max(if patch_nodes > 0 { 3 * places + others } else { 0 });
        let wanted = &world.description().solver;
        let solver = match wanted.solver() {
            Solver::Automatic(config) => AutomaticConfig { bounded: true, ..config }.into(),
            solver => solver,
        };
        let own = world.plan().has_own_factor(world.dt(), world.changes_ever());
        let (mut newton, mut explicit, mut dt) = (None, None, world.dt());
        match *world.integration() {
            Integration::BackwardEuler => {}
            Integration::Newton(_) => {
                newton = Some(NewtonStage::new(model, symbolic, rows));
            }
            Integration::Explicit { dt: substep, .. } => {
                explicit = Some(ExplicitStage::new(model, substep, compliance_rows));
                dt = substep;
            }
        }
        let fem = FemWorkspace::new(model);
        let reach = ReachWorkspace::new(symbolic, compliance_rows).keeping_nodes(symbolic);
        let inverse = PrecomputedWorkspace::new(reach, SolveWorkspace::new(symbolic));
        Self {
            newton,
            explicit,
            direct: DirectStage::new(world, &fem.system, rows),
            limits: (wanted.tolerance, wanted.max_sweeps),
            dt,
            patch: (patch_nodes > 0).then(|| PatchStage::new(world, places, compliance_rows)),
            trial: model.rest_state(),
            fem,
            rotations: vec![Matrix3::identity(); free],
            pcg: PcgWorkspace::new(free).keeping_directions(KEPT_DIRECTIONS),
            solve: SolveWorkspace::new(symbolic),
            v_free: vec![0.0; 3 * free],
            carries: false,
            carried: vec![0.0; 3 * free],
            correction: vec![0.0; 3 * free],
            geometry: world.geometry().clone(),
            detection: DetectionWorkspace::new(world.geometry()),
            rows: ContactRows::with_capacity(contacts),
            fixed_rows: ContactRows::with_capacity(world.detection().max_contacts),
            obstacles: ObstacleStage::new(world),
            rigid: RigidStage::new(world),
            compliance: ComplianceWorkspace::new(compliance_rows, inverse),
            first: None,
            probe: probe_room(world),
            problem: ConstraintProblem::with_capacity(rows),
            lambda: vec![0.0; rows],
            solver,
            solver_workspace: solver.workspace(rows),
            own: own.then(|| Factor::new(Arc::clone(symbolic))),
            own_is_current: false,
            iterations_left: 0,
            load: vec![0.0; 3 * free],
            sample: vec![0.0; 3 * free],
            lambda_of_sample: vec![0.0; rows],
            end: None,
            rescue: super::guard::rescue(world),
            windings: super::tangle::windings(world),
            refinement: RefinementWorkspace::new(rows, 3 * free),
            size: world.mesh().bounding_box().diagonal(),
            change: ChangeStage::new(world),
            problem_files: None,
        }
    }
}
