//! The step's way into the trace.

use palpate_fem::pcg::PcgStatus;
use palpate_trace as trace;
use palpate_trace::StepTrace;

use super::nanoseconds;
use crate::step::{FactorFit, StepReport, StepState, StepStatus, placements};
use crate::world::{Change, World};

/// The step's way into the trace, with its length (s) and the phase whose skin was drawn last.
pub(crate) struct StepLine(pub(super) Option<(StepTrace, f64, usize)>);

impl StepLine {
    /// Hands a report over; wall times stay out where `keep_times` is false, so that equal runs give equal traces.
    pub(crate) fn push(&mut self, report: &StepReport, world: &World, state: &StepState, keep_times: bool) {
        let Some((line, dt, drawn)) = &mut self.0 else { return };
        let wall = |seconds: f64| if keep_times { nanoseconds(seconds) } else { 0 };
        let (times, rotation) = (&report.times, report.tool.frame.rotation.coords);
        let time_ns = nanoseconds(report.time);
        let mut flags = trace::StepFlags::default();
        flags.set(trace::StepFlags::OVERRUN, report.overruns > 0);
        flags.set(trace::StepFlags::CONTACTS_DROPPED, report.dropped() > 0);
        flags.set(trace::StepFlags::FREE_MOTION_UNCONVERGED, report.free_motion.status != PcgStatus::Converged);
        flags.set(trace::StepFlags::CONTACT_UNCONVERGED, !report.solve.is_solved());
        flags.set(trace::StepFlags::FACTOR_REFUSED, report.refused);
        flags.set(trace::StepFlags::NO_COMPLIANCE, !report.compliance.usable);
        flags.set(trace::StepFlags::UNSETTLED, report.unsettled);
        flags.set(trace::StepFlags::ROLLED_BACK, report.status == StepStatus::RolledBack);
        flags.set(trace::StepFlags::CHANGED, report.change.changed);
        let outdated = matches!(report.change.factor, FactorFit::Outdated | FactorFit::Renewed);
        flags.set(trace::StepFlags::FACTOR_OUTDATED, outdated);
        flags.set(trace::StepFlags::TANGLED, report.tangle.is_some());
        flags.set(trace::StepFlags::LED, report.led);
        flags.set(trace::StepFlags::SOLVED_IN_FULL, report.in_full > 0);
        flags.set(trace::StepFlags::CORRECTION_UNCONVERGED, report.error.correction_unconverged);
        flags.set(trace::StepFlags::RESCUED, report.rescued);
        flags.set(trace::StepFlags::SAMPLE_UNCONVERGED, report.error.sample_unconverged);
        line.push(trace::StepRecord {
            step: report.step,
            time_ns,
            dt: *dt,
            assembly_ns: wall(times.assembly),
            free_motion_ns: wall(times.free_motion),
            detection_ns: wall(times.detection),
            compliance_ns: wall(times.compliance),
            solver_ns: wall(times.solve),
            correction_ns: wall(times.correction),
            snapshot_ns: wall(times.hand_over),
            total_ns: wall(times.total),
            contacts: report.detection.contacts as u32,
            cg_iterations: report.free_motion.iterations as u32,
            cg_residual: report.free_motion.relative_residual,
            solver_sweeps: report.solve.iterations,
            solver_residual: report.solve.residual,
            worst_row: report.worst_row.map_or(-1, |row| i32::try_from(row).unwrap_or(i32::MAX)),
            factor_epoch: report.factor_epoch,
            factor_age: report.factor_age,
            tool_force: report.force.into(),
            tool_torque: report.torque.into(),
            inverted_elements: report.assembly.inverted,
            filtered_elements: report.assembly.filtered,
            flags,
            tool_position: report.tool.frame.translation.vector.into(),
            tool_orientation: rotation.into(),
            compliance_error: report.error.along_forces,
            sampled_error: report.error.sampled,
            sampled_row: report.error.sampled_row,
            correction_iterations: report.error.correction_iterations,
            overlap: report.error.overlap,
            cuts: report.cuts,
            solver_attempts: report.attempts,
            phase: report.change.phase,
            tool_opening: report.tool.opening,
            rung: report.rung.map_or(-1, |rung| rung as i32),
            lower_error: report.error.lower,
            force_error: report.error.of_forces(),
        });
        for (body, placement) in placements(world, &state.rigid).enumerate() {
            let (position, orientation, velocity, angular_velocity) = placement;
            let (step, body) = (report.step, body as u32);
            line.push_rigid(trace::RigidRecord {
                step,
                time_ns,
                body,
                position,
                orientation,
                velocity,
                angular_velocity,
            });
        }
        let skin = state.change(world, state.phase()).filter(|_| state.phase() != *drawn).map(Change::triangles);
        let offer = line.push_positions(time_ns, skin, |positions| {
            for (x, q) in positions.chunks_exact_mut(3).zip(&state.fem.q) {
                x.copy_from_slice(q.as_slice());
            }
        });
        if offer == trace::Offer::Taken {
            *drawn = state.phase();
        }
    }
}
