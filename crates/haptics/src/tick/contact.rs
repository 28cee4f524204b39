//! The contact of a tick: its problem at the newest pose, and what of its wrench is sent.

use nalgebra::{Isometry3, Vector3};
use palpate_collision::ToolPose;

use super::grip::is_sound;
use super::local::{Local, Problem, TickWorkspace};
use super::patch::{PatchProblem, ToolPoses};
use super::{Tick, TickState};
use crate::device::DeviceSample;
use crate::record::TickFlags;
use crate::snapshot::HapticSnapshot;
use crate::wrench::Wrench;

const NOT_A_WRENCH: Wrench =
    Wrench { force: Vector3::new(f64::NAN, f64::NAN, f64::NAN), torque: Vector3::new(f64::NAN, f64::NAN, f64::NAN) };

impl Tick {
    /// Solves the snapshot that is about to be replaced at the newest pose, so that the tick that follows can measure
    /// the jump of force which the new snapshot brings, and that alone. λ starts the new one.
    #[cfg_attr(rtsan, sanitize(realtime = "nonblocking"))]
    pub fn weigh_outgoing(
        &self,
        state: &mut TickState,
        outgoing: &HapticSnapshot,
        sample: &DeviceSample,
        ws: &mut TickWorkspace,
    ) {
        if outgoing.valid && state.believed && state.step == Some(outgoing.step) && is_sound(sample) {
            self.read(state, sample);
            let poses = self.poses(state, sample);
            let local = match (self.local(outgoing), &state.patch) {
                (Some(problem), Some(memory)) => {
                    // The tick that this one would have been.
                    let now = memory.moment(problem.config.hand_over, 1.0);
                    problem.solve(memory, &outgoing.patch, &poses, &now, ws)
                }
                _ => self.problem().solve(&mut state.warm_start, outgoing, &poses.predicted, ws),
            };
            if local.finite && local.wrench.is_finite() {
                state.outgoing = Some(local.wrench.force);
            } else {
                state.warm_start.clear_forces();
            }
        }
    }

    /// Contact at the newest pose, and what of its wrench is sent.
    pub(super) fn touch(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        sample: &DeviceSample,
        dt: f64,
        ws: &mut TickWorkspace,
        flags: &mut TickFlags,
    ) -> (Wrench, Local) {
        let poses = self.poses(state, sample);
        let local = self.solve(state, snapshot, &poses, ws, flags);
        flags.set_if(local.truncated, TickFlags::TRUNCATED);
        flags.set_if(!local.converged, TickFlags::NOT_CONVERGED);
        state.coupling = self.coupling.settle(&state.coupling, &local.wrench);
        self.settle_gripper(state, local.gripper);
        self.keep(state, snapshot, &sample.pose, ws);
        let free = local.active == 0 && !flags.contains(TickFlags::BEYOND_PATCH);
        flags.set_if(state.jump.withdraws(free), TickFlags::JUMPED);
        // Numbers in W or δ_free that are not finite end the force, even where λ is finite.
        let target = if local.finite { local.wrench } else { NOT_A_WRENCH };
        let sent = self.send(state, &target, dt, flags);
        if flags.contains(TickFlags::NON_FINITE) {
            state.cut();
            state.warm_start.clear_forces();
            (sent, Local { wrench: Wrench::zero(), gripper: 0.0, active: 0, ..local })
        } else {
            (sent, local)
        }
    }

    /// What is left of a contact wrench by the fades, by the energy of the port, and by the limits.
    fn send(&self, state: &mut TickState, target: &Wrench, dt: f64, flags: &mut TickFlags) -> Wrench {
        if flags.contains(TickFlags::JUMPED) && target.is_finite() {
            return self.limits.release(&mut state.limits, dt, flags);
        }
        let Some(faded) = self.limits.fade(&mut state.limits, target, state.age, dt, flags) else {
            return Wrench::zero();
        };
        let passive = self.passivity.act(&state.passivity, &faded, &state.device_velocity, dt, flags);
        self.limits.bound(&mut state.limits, &passive, &state.device_velocity, dt, flags)
    }

    fn problem(&self) -> Problem<'_> {
        Problem { solver: &self.solver, coupling: &self.coupling, gripper: self.gripper.as_ref() }
    }

    /// What solves on the snapshot's patch, where the tick works on patches and the snapshot has one.
    fn local(&self, snapshot: &HapticSnapshot) -> Option<PatchProblem<'_>> {
        let config = self.patch.as_ref().filter(|_| snapshot.patch.valid)?;
        Some(PatchProblem { solver: &self.solver, coupling: &self.coupling, gripper: self.gripper.as_ref(), config })
    }

    fn poses(&self, state: &TickState, sample: &DeviceSample) -> ToolPoses {
        let held = self.tool(state, &sample.pose);
        let frame = self.coupling.predict(&state.coupling, &sample.pose);
        let opening = self.gripper.as_ref().map_or(0.0, |gripper| gripper.predict(&state.gripper));
        ToolPoses { held, predicted: ToolPose { frame, opening } }
    }

    /// The contact problem of the tick: on the patch, or on the snapshot's own rows.
    fn solve(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        poses: &ToolPoses,
        ws: &mut TickWorkspace,
        flags: &mut TickFlags,
    ) -> Local {
        match (self.local(snapshot), &mut state.patch) {
            (Some(problem), Some(memory)) => {
                // Forgotten between two snapshots, after a fault: it begins anew on this one.
                if !memory.is_of(&snapshot.patch) {
                    memory.forget();
                    let times = (snapshot.dt, self.period, problem.config.hand_over);
                    memory.take_over(&snapshot.patch, &snapshot.tool(), times);
                }
                flags.set(TickFlags::LOCAL);
                let beyond = problem.is_beyond(&snapshot.patch, &snapshot.tool(), &poses.held);
                flags.set_if(beyond, TickFlags::BEYOND_PATCH);
                let now = memory.moment(problem.config.hand_over, 0.0);
                problem.solve(memory, &snapshot.patch, poses, &now, ws)
            }
            _ => self.problem().solve(&mut state.warm_start, snapshot, &poses.predicted, ws),
        }
    }

    /// Lets a tick on a patch be remembered.
    fn keep(&self, state: &mut TickState, snapshot: &HapticSnapshot, device: &Isometry3<f64>, ws: &TickWorkspace) {
        let tool = self.tool(state, device);
        if let (Some(problem), Some(memory), Some(ws)) = (self.local(snapshot), &mut state.patch, &ws.patch) {
            memory.keep(&snapshot.patch, problem.config.hand_over, &tool, ws);
        }
    }
}
