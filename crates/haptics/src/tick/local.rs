//! The local problem of a tick: the snapshot's, with the coupling's compliance, at the newest pose.

use nalgebra::Vector3;
use palpate_collision::ToolPose;
use palpate_constraints::law::Signorini;
use palpate_solver::gauss_seidel::{self, GaussSeidelConfig, GaussSeidelWorkspace};
use palpate_solver::problem::{Block, ProblemView};

use super::patch::{PatchTickConfig, PatchWorkspace};
use super::warm_start::WarmStart;
use crate::coupling::Coupling;
use crate::gripper::Gripper;
use crate::snapshot::{HapticSnapshot, ROWS_PER_CONTACT};
use crate::wrench::Wrench;

/// Scratch of a tick, which may be thrown away between any two.
#[derive(Clone, Debug)]
pub struct TickWorkspace {
    /// Snapshot that `w` was made from.
    step: Option<u64>,
    /// W + c J_f J_fᵀ \[m/N\].
    pub(super) w: Vec<f64>,
    /// Whether all of `w` is.
    finite: bool,
    delta: Vec<f64>,
    /// The snapshot's, each with the law that belongs to its gap.
    blocks: Vec<Block>,
    pub(super) solver: GaussSeidelWorkspace,
    /// For snapshots with a patch.
    pub(super) patch: Option<PatchWorkspace>,
}

impl TickWorkspace {
    /// Scratch for snapshots of up to `max_contacts` contacts.
    #[must_use]
    pub fn new(max_contacts: usize) -> Self {
        let rows = ROWS_PER_CONTACT * max_contacts;
        let solver = GaussSeidelWorkspace::with_capacity(rows);
        let blocks = vec![Block { start: 0, law: Signorini.into() }; max_contacts];
        let (w, delta) = (vec![0.0; rows * rows], vec![0.0; rows]);
        Self { step: None, w, finite: true, delta, blocks, solver, patch: None }
    }

    /// The same, for snapshots that carry a patch too.
    pub(super) fn with_patch(max_contacts: usize, config: &PatchTickConfig) -> Self {
        Self {
            patch: Some(PatchWorkspace::new(config)),
            ..Self::new(max_contacts.max(config.detection.max_contacts + config.max_bodies))
        }
    }

    /// Lets W be made anew.
    pub(super) fn forget(&mut self) {
        self.step = None;
    }

    fn max_contacts(&self) -> usize {
        self.delta.len() / ROWS_PER_CONTACT
    }
}

/// Answer of the local problem.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    pub(super) wrench: Wrench,
    /// Torque on the opening of the jaws \[N m\].
    pub(super) gripper: f64,
    /// Smallest gap at λ \[m\]; infinite without contacts.
    pub(super) gap: f64,
    pub(super) contacts: u32,
    pub(super) active: u32,
    pub(super) sweeps: u32,
    pub(super) residual: f64,
    pub(super) converged: bool,
    pub(super) truncated: bool,
    /// Whether all that went in and came out was finite.
    pub(super) finite: bool,
}

impl Local {
    pub(super) const EMPTY: Self = Self {
        wrench: Wrench { force: Vector3::new(0.0, 0.0, 0.0), torque: Vector3::new(0.0, 0.0, 0.0) },
        gripper: 0.0,
        gap: f64::INFINITY,
        contacts: 0,
        active: 0,
        sweeps: 0,
        residual: 0.0,
        converged: true,
        truncated: false,
        finite: true,
    };
}

/// What a tick solves with: description.
#[derive(Clone, Copy, Debug)]
pub(super) struct Problem<'a> {
    pub(super) solver: &'a GaussSeidelConfig,
    pub(super) coupling: &'a Coupling,
    pub(super) gripper: Option<&'a Gripper>,
}

impl Problem<'_> {
    /// The local problem with the tool predicted at this pose.
    pub(super) fn solve(
        &self,
        warm_start: &mut WarmStart,
        snapshot: &HapticSnapshot,
        predicted: &ToolPose,
        ws: &mut TickWorkspace,
    ) -> Local {
        let contacts = snapshot.contacts().min(ws.max_contacts()).min(warm_start.max_contacts());
        let rows =
            snapshot.blocks().get(contacts).map_or(snapshot.rows(), |first_without_room| first_without_room.start);
        let truncated = contacts < snapshot.contacts();
        if rows == 0 {
            return Local { truncated, ..Local::EMPTY };
        }
        let tool_rows = &snapshot.tool_rows()[..rows];
        self.prepare(snapshot, rows, ws);
        move_tool(snapshot, tool_rows, predicted, &mut ws.delta);

        let lambda = warm_start.lambda_mut(rows);
        for (own, block) in ws.blocks.iter_mut().zip(snapshot.blocks()) {
            let gap = ws.delta.get(block.start).copied().unwrap_or(0.0);
            *own = Block { law: block.law.at_free_gap(gap), ..*block };
        }
        let blocks = &ws.blocks[..contacts];
        let (compliance, delta_free) = (&ws.w[..rows * rows], &ws.delta[..rows]);
        let problem = ProblemView { compliance, stride: rows, delta_free, blocks };
        let report = gauss_seidel::solve(&problem, lambda, self.solver, &mut ws.solver);

        let carries = |start: usize| lambda.get(start).is_some_and(|normal| *normal != 0.0);
        let active = blocks.iter().filter(|block| carries(block.start)).count();
        let gaps = blocks.iter().filter_map(|block| ws.solver.delta().get(block.start));
        let gap = gaps.fold(f64::INFINITY, |least, gap| least.min(*gap));
        let wrench = wrench_of(tool_rows, lambda);
        let finite = ws.finite && report.residual.is_finite() && delta_free.iter().all(|gap| gap.is_finite());
        Local {
            finite,
            wrench,
            gripper: snapshot.gripper_rows().iter().zip(&*lambda).map(|(row, lambda)| row * lambda).sum(),
            gap,
            contacts: contacts as u32,
            active: active as u32,
            sweeps: report.iterations,
            residual: report.residual,
            converged: report.is_solved(),
            truncated,
        }
    }

    /// W_tick, once a snapshot.
    fn prepare(&self, snapshot: &HapticSnapshot, rows: usize, ws: &mut TickWorkspace) {
        if ws.step == Some(snapshot.step) {
            return;
        }
        let w = &mut ws.w[..rows * rows];
        for (line, of_snapshot) in w.chunks_exact_mut(rows).zip(snapshot.compliance().chunks_exact(snapshot.rows())) {
            line.copy_from_slice(&of_snapshot[..rows]);
        }
        self.coupling.add_compliance(&snapshot.tool_rows()[..rows], w);
        if let Some(gripper) = self.gripper {
            let rates = &snapshot.gripper_rows()[..rows];
            for (line, a) in w.chunks_exact_mut(rows).zip(rates) {
                line.iter_mut().zip(rates).for_each(|(w, b)| *w += gripper.compliance() * a * b);
            }
        }
        ws.finite = w.iter().all(|w| w.is_finite());
        ws.step = Some(snapshot.step);
    }
}

/// δ at the predicted pose.
fn move_tool(snapshot: &HapticSnapshot, tool_rows: &[[f64; 6]], predicted: &ToolPose, delta: &mut [f64]) {
    let (frame, opened) = (&predicted.frame, predicted.opening - snapshot.opening);
    let moved = frame.translation.vector - snapshot.tool_pose.translation.vector;
    let turned = (frame.rotation * snapshot.tool_pose.rotation.inverse()).scaled_axis();
    let rows = tool_rows.iter().zip(snapshot.gripper_rows());
    for ((delta, free), (row, gripper)) in delta.iter_mut().zip(snapshot.delta_free()).zip(rows) {
        let rotation = row[3] * turned.x + row[4] * turned.y + row[5] * turned.z;
        *delta = free + row[0] * moved.x + row[1] * moved.y + row[2] * moved.z + rotation;
        if *gripper != 0.0 {
            *delta += gripper * opened;
        }
    }
}

/// Jᵀ λ.
fn wrench_of(tool_rows: &[[f64; 6]], lambda: &[f64]) -> Wrench {
    let mut wrench = Wrench::zero();
    for (row, lambda) in tool_rows.iter().zip(lambda) {
        wrench.force += Vector3::new(row[0], row[1], row[2]) * *lambda;
        wrench.torque += Vector3::new(row[3], row[4], row[5]) * *lambda;
    }
    wrench
}
