//! What one step did.

use nalgebra::Vector3;
use palpate_collision::PatchReport;
use palpate_collision::ToolPose;
use palpate_collision::detection::DetectionReport;
use palpate_constraints::compliance::{ComplianceMethod, ComplianceReport};
use palpate_constraints::rows::RowReport;
use palpate_fem::assembly::{AssemblyReport, FoldReport};
use palpate_fem::pcg::{PcgReport, PcgStatus};
use palpate_solver::report::SolveReport;

use super::StepInput;
use super::bodies::BodiesReport;
use super::change::ChangeReport;
use super::compliance_error::ComplianceError;
use super::forces::NOT_SOLVED;
use super::times::StepTimes;
use crate::world::Rung;

/// How a step ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StepStatus {
    /// The body moved on.
    #[default]
    Advanced,
    /// The body would have become non-finite, or a node would have moved away from it by ten times its size; it was put
    /// back to the state before the step.
    RolledBack,
}

/// The element at which a body failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FailedElement {
    /// Tetrahedron of the mesh.
    pub tetrahedron: u32,
    /// Its region, as the mesh numbers them; 0 where it has none.
    pub region: u16,
}

/// Tissue that has passed through itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tangle {
    /// Inner edges that the tissue does not wind round once.
    pub edges: u32,
    /// How often it winds round the worst of them: 2 where it lies upon itself, 0 or less beside elements inside out.
    pub winding: i32,
    /// An element at that edge.
    pub place: FailedElement,
}

/// What one step did. Plain data: copied into rings, traces and tables.
#[derive(Clone, Copy, Debug)]
pub struct StepReport {
    /// Number of the step, counted from 0.
    pub step: u64,
    /// Time at its begin (s).
    pub time: f64,
    /// How it ended.
    pub status: StepStatus,
    /// Where the body was rolled back: the element whose force or stiffness is not finite, or else one at the node that
    /// went farthest astray.
    pub failed: Option<FailedElement>,
    /// What events did to the body.
    pub change: ChangeReport,
    /// Pose of the tool that it used, and the opening of its jaws.
    pub tool: ToolPose,
    /// Assembly of forces and matrix; the worst of the forces of all explicit substeps.
    pub assembly: AssemblyReport,
    /// Linear solves of the free motion: conjugate gradients, or Newton's iterations with the residual that they leave.
    /// None for explicit substeps. Where an exact correction went on with what they left, their residual may be a
    /// thousand times the scene's tolerance, and that of the whole motion is
    /// [`ComplianceError::correction_residual`](super::ComplianceError::correction_residual).
    pub free_motion: PcgReport,
    /// Solves with the latest factor, in free motion, correction and hand-over, that went by its stored values: its
    /// copy in 16 bits was refused, or their numbers have left the range of it. They are as good, and take twice as
    /// long and more.
    pub in_full: u32,
    /// Halvings of the motion: by the guard of the linearised step, or by the line search of Newton's method.
    pub cuts: u32,
    /// Linearisations by which the guard repeated the motion; 0 where one was enough.
    pub repeated: u32,
    /// Elements that are held open at the begin of the step: quadratic ones that fold between the points at which they are
    /// evaluated, others that had come to rest inside out.
    pub folds: FoldReport,
    /// Tissue that has passed through itself, at the begin of the step. Looked for from when the guard acted or an element
    /// was inside out until the body is whole.
    pub tangle: Option<Tangle>,
    /// True where the body was led out of a tangle: it answered as linear elasticity in place of its law.
    pub led: bool,
    /// Contacts with the tool: found, merged, dropped.
    pub detection: DetectionReport,
    /// Contacts of fixed and rigid bodies with the tissue and with one another.
    pub bodies: BodiesReport,
    /// Rows built from all contacts.
    pub rows: RowReport,
    /// The tissue around the tool that the tick got; empty where it has frozen rows.
    pub patch: PatchReport,
    /// True where the tick got frozen rows in place of a patch since the tool's contacts with rigid and fixed bodies
    /// found no room in one.
    pub frozen_at_rigid: bool,
    /// `W`; where it is not usable the step goes on without contact.
    pub compliance: ComplianceReport,
    /// Method that gave `W`.
    pub method: ComplianceMethod,
    /// Where the run stood on its ladder of methods; none without one.
    pub rung: Option<Rung>,
    /// How wrong `W` and the motion are.
    pub error: ComplianceError,
    /// True where this step's matrix was to be factored and could not be.
    pub refused: bool,
    /// True where a linear solve ended without convergence and the step factored its own matrix to go on.
    pub rescued: bool,
    /// True where motion and contact forces of Newton's method were repeated as often as a step allows and the forces
    /// still changed: motion and forces belong together only to the last change.
    pub unsettled: bool,
    /// Constraint solve. Iterations are those of the scene's solver, interior-point iterations of Lagrange multipliers or
    /// Newton's of penalty contact; the residual is that of the law of contact for each.
    pub solve: SolveReport,
    /// Solvers that were tried: above 1 where the automatic choice fell back. The most of all solves of the step.
    pub attempts: u32,
    /// Register name of the solver whose forces were taken, or of the direct method; empty where nothing was solved.
    pub solver: &'static str,
    /// First row of the contact with the largest residual; none without contacts.
    pub worst_row: Option<u32>,
    /// Contacts with the tool that carry a force.
    pub active: usize,
    /// Force of the tissue on the tool (N).
    pub force: Vector3<f64>,
    /// Torque of the tissue on the tool about its origin (N m).
    pub torque: Vector3<f64>,
    /// Size of the part of the force along the skin: the vector sum of friction (N).
    pub tangential_force: f64,
    /// How far the touched skin is pushed from its place at rest, along the contact normal (m).
    pub indentation: f64,
    /// Epoch of the factor that was used.
    pub factor_epoch: u64,
    /// Age of that factor (s).
    pub factor_age: f64,
    /// Times of the stages.
    pub times: StepTimes,
    /// How late the step began (s).
    pub latency: f64,
    /// Deadlines missed since the last step.
    pub overruns: u32,
}

impl StepReport {
    pub(super) fn begin(step: u64, input: &StepInput<'_>, dt: f64) -> Self {
        let age = (input.time - input.factor.time).max(0.0);
        Self {
            step,
            time: input.time,
            status: StepStatus::Advanced,
            failed: None,
            change: ChangeReport::default(),
            tool: input.tool,
            assembly: AssemblyReport::NONE,
            free_motion: PcgReport { status: PcgStatus::Converged, iterations: 0, relative_residual: 0.0 },
            in_full: 0,
            cuts: 0,
            repeated: 0,
            folds: FoldReport::NONE,
            tangle: None,
            led: false,
            detection: DetectionReport::NONE,
            bodies: BodiesReport::NONE,
            rows: RowReport::default(),
            patch: PatchReport::default(),
            frozen_at_rigid: false,
            compliance: ComplianceReport { rows: 0, diagonal: [0.0; 2], asymmetry: 0.0, usable: true },
            method: ComplianceMethod::Automatic,
            rung: None,
            error: ComplianceError::NONE,
            refused: false,
            rescued: false,
            unsettled: false,
            solve: NOT_SOLVED,
            attempts: 0,
            solver: "",
            worst_row: None,
            active: 0,
            force: Vector3::zeros(),
            torque: Vector3::zeros(),
            tangential_force: 0.0,
            indentation: 0.0,
            factor_epoch: input.factor.epoch,
            factor_age: if age < 0.5 * dt { 0.0 } else { age },
            times: StepTimes::default(),
            latency: 0.0,
            overruns: 0,
        }
    }

    /// Contacts that found no room in the step, of any pair of bodies: at detection, or among the rows.
    pub fn dropped(&self) -> u64 {
        self.detection.dropped as u64 + u64::from(self.bodies.dropped) + self.rows.dropped as u64
    }

    /// Names and units of [`StepReport::row`].
    pub const COLUMNS: [&'static str; 43] = [
        "step",
        "time_s",
        "tool_x_m",
        "tool_y_m",
        "tool_z_m",
        "tool_qw",
        "tool_qx",
        "tool_qy",
        "tool_qz",
        "force_x_n",
        "force_y_n",
        "force_z_n",
        "torque_x_nm",
        "torque_y_nm",
        "torque_z_nm",
        "tangential_force_n",
        "indentation_m",
        "contacts",
        "active_contacts",
        "residual",
        "contact_unsolved",
        "sweeps",
        "solver_attempts",
        "cg_iterations",
        "cg_residual",
        "cuts",
        "factor_epoch",
        "factor_age_s",
        "compliance_error_along_forces",
        "compliance_error_sampled",
        "sample_unconverged",
        "force_error",
        "force_error_of_lower_rung",
        "rung",
        "correction_iterations",
        "correction_residual",
        "rescued",
        "overlap_m",
        "patch_nodes",
        "patch_triangles_left_out",
        "rolled_back",
        "phase",
        "work_s",
    ];

    /// The report as one row of a table.
    pub fn row(&self) -> [f64; 43] {
        let p = self.tool.frame.translation.vector;
        let r = self.tool.frame.rotation;
        [
            self.step as f64,
            self.time,
            p.x,
            p.y,
            p.z,
            r.w,
            r.i,
            r.j,
            r.k,
            self.force.x,
            self.force.y,
            self.force.z,
            self.torque.x,
            self.torque.y,
            self.torque.z,
            self.tangential_force,
            self.indentation,
            self.detection.contacts as f64,
            self.active as f64,
            self.solve.residual,
            f64::from(u8::from(!self.solve.is_solved())),
            f64::from(self.solve.iterations),
            f64::from(self.attempts),
            self.free_motion.iterations as f64,
            self.free_motion.relative_residual,
            f64::from(self.cuts),
            self.factor_epoch as f64,
            self.factor_age,
            self.error.along_forces,
            self.error.sampled,
            f64::from(u8::from(self.error.sample_unconverged)),
            self.error.of_forces().unwrap_or(f64::NAN),
            self.error.lower,
            self.rung.map_or(f64::NAN, |rung| f64::from(rung as u8)),
            f64::from(self.error.correction_iterations),
            self.error.correction_residual,
            f64::from(u8::from(self.rescued)),
            self.error.overlap,
            self.patch.nodes as f64,
            self.patch.left_out as f64,
            f64::from(u8::from(self.status == StepStatus::RolledBack)),
            f64::from(self.change.phase),
            self.times.total,
        ]
    }
}
