//! Reports of the stages on their way into the trace, and back out of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use palpate_fem::factor::FactorStatus;
use palpate_fem::pcg::PcgStatus;
use palpate_haptics::device::DeviceSpec;
use palpate_haptics::record::TickFlags;
use palpate_trace as trace;
use palpate_trace::{
    Attachment, BodyGeometry, FactorTrace, InlineTrace, LogLevel, LogRecord, StepTrace, TickTrace, TraceConfig,
    TraceError, TraceThread,
};
use serde::Serialize;

use crate::drawn::{solids, tool};
use crate::gathering::Gathering;
use crate::refresh::RefreshReport;
use crate::run::{RunError, RunOptions};
use crate::step::{FactorFit, StepReport, StepState, StepStatus, placements};
use crate::tick::TickReport;
use crate::world::World;

/// Attachment that holds the scene.
pub(crate) const SCENE: &str = "scene.toml";

/// Mode of a run in virtual time, in the metadata of its trace.
pub(crate) const LOCKSTEP: &str = "lockstep";

/// Entry of the trace's engine record for the limits that the device stated, as TOML.
pub(crate) const DEVICE_RECORD: &str = "device_record";

/// Metadata record that says how the run ended, and its entry for the number of ticks.
pub(crate) const END: &str = "end";
pub(crate) const TICKS: &str = "ticks";

/// What became of a trace.
#[derive(Clone, Debug, Serialize)]
pub struct TraceOutcome {
    /// The file.
    pub path: PathBuf,
    /// Size (bytes).
    pub bytes: u64,
    /// Messages written.
    pub messages: u64,
    /// Records dropped because a ring was full.
    pub dropped: u64,
    /// What went wrong while it was written, if anything.
    pub error: Option<String>,
}

/// The trace itself: written by its own thread in real time, in between in lockstep, where nothing may be dropped.
pub(crate) enum TraceLines {
    Thread(TraceThread),
    Inline(Box<InlineTrace>),
}

/// The lines of the three stages and the trace that they lead to.
type Lines = (StepLine, TickLine, FactorLine, Option<TraceLines>);

impl TraceLines {
    /// Opens the trace that the options name. A file that cannot be made is noted, and the run goes on without one.
    pub(crate) fn open(
        world: &World,
        options: &RunOptions,
        device: &DeviceSpec,
        notes: &mut Vec<String>,
    ) -> Result<Lines, RunError> {
        match &options.trace {
            None => Ok(Self::none()),
            Some(path) => match Self::create(world, options, device, path) {
                Err(error @ TraceError::Create { .. }) => {
                    notes.push(format!("{error}; the run goes on without a trace"));
                    Ok(Self::none())
                }
                lines => Ok(lines?),
            },
        }
    }

    fn none() -> Lines {
        (StepLine(None), TickLine(None), FactorLine(None), None)
    }

    fn create(world: &World, options: &RunOptions, device: &DeviceSpec, path: &Path) -> Result<Lines, TraceError> {
        let config = config(world, options, device);
        let (ticks, steps, factors, lines) = if options.lockstep {
            let (inline, ticks, steps, factors) = InlineTrace::create(path, &config)?;
            (ticks, steps, factors, Self::Inline(Box::new(inline)))
        } else {
            let (thread, ticks, steps, factors) = TraceThread::spawn(path, &config)?;
            (ticks, steps, factors, Self::Thread(thread))
        };
        Ok((StepLine(Some((steps, world.dt()))), TickLine(Some(ticks)), FactorLine(Some(factors)), Some(lines)))
    }

    /// In lockstep, writes what waits in the rings.
    pub(crate) fn drain(&mut self) {
        if let Self::Inline(inline) = self {
            inline.drain();
        }
    }

    /// Writes the notes of the run and how it ended, and closes the file.
    pub(crate) fn finish(self, gathering: &Gathering) -> TraceOutcome {
        let [steps, factors, ticks] = gathering.counts();
        let end = BTreeMap::from([
            ("end".to_string(), gathering.end.name().to_string()),
            ("steps".into(), steps.to_string()),
            ("factors".into(), factors.to_string()),
            (TICKS.into(), ticks.to_string()),
        ]);
        let time_ns = nanoseconds(gathering.progress().time);
        let line = |level, text: &str| LogRecord::new(time_ns, level, "run", text);
        let notes = gathering.notes.iter().map(|note| line(LogLevel::Warning, note));
        let notes = notes.chain([line(LogLevel::Info, &format!("the run ended: {}", gathering.end))]);
        // A line that finds no room is counted with the other drops.
        let summary = match self {
            Self::Thread(mut thread) => {
                notes.for_each(|note| _ = thread.log(note));
                thread.set_end(end);
                thread.finish()
            }
            Self::Inline(mut inline) => {
                notes.for_each(|note| _ = inline.log(note));
                inline.set_end(end);
                inline.finish()
            }
        };
        TraceOutcome {
            path: summary.path,
            bytes: summary.bytes,
            messages: summary.messages.iter().map(|(_, n)| n).sum(),
            dropped: summary.dropped.total(),
            error: summary.failure.map(|e| e.to_string()),
        }
    }
}

fn config(world: &World, options: &RunOptions, device: &DeviceSpec) -> TraceConfig {
    let scene = world.description();
    let base = if options.lockstep { TraceConfig::default() } else { TraceConfig::real_time() };
    let length = options.length.seconds(world.dt());
    let engine = BTreeMap::from([
        ("version".to_string(), env!("CARGO_PKG_VERSION").to_string()),
        ("scene".into(), scene.name.clone()),
        ("embedded".into(), world.scene().is_embedded().to_string()),
        ("folder".into(), world.scene().folder().display().to_string()),
        ("mode".into(), if options.lockstep { LOCKSTEP } else { "real time" }.into()),
        ("seconds".into(), format!("{length:?}")),
        ("step_rate_hz".into(), format!("{:?}", scene.rates.step)),
        ("factor_rate_hz".into(), format!("{:?}", scene.rates.factor)),
        ("tick_rate_hz".into(), format!("{:?}", scene.rates.tick)),
        // What hardware says of itself is not in the scene. Numbers and names can be written as TOML.
        (DEVICE_RECORD.into(), toml::to_string(device).unwrap_or_default()),
    ]);
    let scene_file =
        Attachment { name: SCENE.into(), media_type: "application/toml".into(), data: world.scene().text().into() };
    let rest = world.mesh().nodes.iter().map(|x| [x.x, x.y, x.z]).collect();
    TraceConfig {
        engine,
        attachments: vec![scene_file],
        bodies: vec![BodyGeometry::new(scene.bodies[0].name.clone(), rest, world.surface().triangles.clone())],
        solids: solids(world),
        tool: tool(world.tool()),
        ..base
    }
}

/// The step's way into the trace.
pub(crate) struct StepLine(Option<(StepTrace, f64)>);

/// The tick's way into the trace.
pub(crate) struct TickLine(Option<TickTrace>);

/// The factor stage's way into the trace.
pub(crate) struct FactorLine(Option<FactorTrace>);

fn nanoseconds(seconds: f64) -> u64 {
    // Saturates: negative and non-finite times become 0.
    (seconds * 1e9).round() as u64
}

impl StepLine {
    /// Hands a report over; wall times stay out where `keep_times` is false, so that equal runs give equal traces.
    pub(crate) fn push(&mut self, report: &StepReport, world: &World, state: &StepState, keep_times: bool) {
        let Some((line, dt)) = &mut self.0 else { return };
        let wall = |seconds: f64| if keep_times { nanoseconds(seconds) } else { 0 };
        let (times, rotation) = (&report.times, report.tool.frame.rotation.coords);
        let time_ns = nanoseconds(report.time);
        let mut flags = trace::StepFlags::default();
        flags.set(trace::StepFlags::OVERRUN, report.overruns > 0);
        flags.set(trace::StepFlags::CONTACTS_DROPPED, report.detection.dropped > 0);
        flags.set(trace::StepFlags::FREE_MOTION_UNCONVERGED, report.free_motion.status != PcgStatus::Converged);
        flags.set(trace::StepFlags::CONTACT_UNCONVERGED, !report.solve.is_solved());
        flags.set(trace::StepFlags::FACTOR_REFUSED, report.refused);
        flags.set(trace::StepFlags::NO_COMPLIANCE, !report.compliance.usable);
        flags.set(trace::StepFlags::UNSETTLED, report.unsettled);
        flags.set(trace::StepFlags::ROLLED_BACK, report.status == StepStatus::RolledBack);
        flags.set(trace::StepFlags::CHANGED, report.change.changed);
        flags.set(trace::StepFlags::FACTOR_OUTDATED, report.change.factor == FactorFit::Outdated);
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
        line.push_positions(time_ns, |positions| {
            for (x, q) in positions.chunks_exact_mut(3).zip(&state.fem.q) {
                x.copy_from_slice(q.as_slice());
            }
        });
    }
}

impl TickLine {
    /// A line that leads nowhere.
    pub(crate) fn none() -> Self {
        Self(None)
    }

    /// Hands a report over.
    pub(crate) fn push(&mut self, report: &TickReport) {
        let Some(line) = &mut self.0 else { return };
        let r = &report.record;
        let mut flags = trace::TickFlags::default();
        flags.set(trace::TickFlags::FORCE_LIMITED, r.flags.contains(TickFlags::FORCE_LIMITED));
        flags.set(trace::TickFlags::SLEW_LIMITED, r.flags.contains(TickFlags::SLEW_LIMITED));
        flags.set(trace::TickFlags::FADING, r.gain < 1.0);
        flags.set(trace::TickFlags::STALE_SNAPSHOT, r.flags.contains(TickFlags::STALE));
        flags.set(trace::TickFlags::NON_FINITE, r.flags.contains(TickFlags::NON_FINITE));
        flags.set(trace::TickFlags::DEVICE_MISSING, r.flags.contains(TickFlags::DEVICE_ERROR));
        flags.set(trace::TickFlags::OVERRUN, report.overruns > 0);
        flags.set(trace::TickFlags::CONTACTS_DROPPED, r.flags.contains(TickFlags::TRUNCATED));
        let no_snapshot = r.flags.contains(TickFlags::NO_SNAPSHOT) || r.flags.contains(TickFlags::INVALID_SNAPSHOT);
        flags.set(trace::TickFlags::NO_SNAPSHOT, no_snapshot);
        flags.set(trace::TickFlags::BAD_POSE, r.flags.contains(TickFlags::BAD_POSE));
        flags.set(trace::TickFlags::NEW_SNAPSHOT, r.flags.contains(TickFlags::NEW_SNAPSHOT));
        flags.set(trace::TickFlags::UNCONVERGED, r.flags.contains(TickFlags::NOT_CONVERGED));
        flags.set(trace::TickFlags::LOCAL, r.flags.contains(TickFlags::LOCAL));
        flags.set(trace::TickFlags::BEYOND_PATCH, r.flags.contains(TickFlags::BEYOND_PATCH));
        line.push(trace::TickRecord {
            tick: r.index,
            time_ns: nanoseconds(r.time),
            device_position: r.device_pose.translation.vector.into(),
            device_orientation: r.device_pose.rotation.coords.into(),
            device_velocity: r.device_velocity.linear.into(),
            device_angular_velocity: r.device_velocity.angular.into(),
            tool_position: r.tool_pose.translation.vector.into(),
            tool_orientation: r.tool_pose.rotation.coords.into(),
            force: r.wrench.force.into(),
            torque: r.wrench.torque.into(),
            force_unlimited: r.contact_wrench.force.into(),
            gap: if r.contacts > 0 { r.gap } else { f64::NAN },
            contacts: r.active,
            sweeps: r.sweeps,
            residual: r.residual,
            snapshot_step: r.snapshot_step,
            snapshot_age: r.snapshot_age,
            flags,
            wake_latency_ns: nanoseconds(report.latency),
            work_ns: nanoseconds(report.work),
            force_jump: r.force_jump,
            device_gripper: r.gripper.device,
            tool_opening: r.gripper.opening,
            gripper_torque: r.gripper.torque,
            gripper_torque_unlimited: r.gripper.contact_torque,
            torque_unlimited: r.contact_wrench.torque.into(),
        });
    }
}

impl FactorLine {
    /// Hands a report over.
    pub(crate) fn push(&mut self, report: &RefreshReport, keep_times: bool) {
        let Some(line) = &mut self.0 else { return };
        let duration_ns = if keep_times { nanoseconds(report.work) } else { 0 };
        line.push(trace::FactorRecord {
            epoch: report.epoch,
            time_ns: nanoseconds(report.handed_over),
            taken_ns: nanoseconds(report.time),
            taken_step: report.step,
            duration_ns,
            status: match report.status {
                FactorStatus::Ok => trace::FactorStatus::Ready,
                FactorStatus::NonFinite { .. } => trace::FactorStatus::NonFinite,
                _ => trace::FactorStatus::Indefinite,
            },
        });
    }
}
