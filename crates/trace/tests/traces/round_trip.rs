//! What is written is read back, to the bit.

use crate::sample;
use palpate_trace::{
    FactorRecord, FactorStatus, InlineTrace, LogLevel, LogRecord, StepFlags, StepRecord, TickFlags, TickRecord, Topic,
    Trace, TraceReader, TraceWriter,
};
use std::io::Cursor;

/// Bits of every kind: xorshift64*, then the doubles that arithmetic comparison would not tell apart or equal.
struct Bits(u64);

impl Bits {
    fn word(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    fn double(&mut self) -> f64 {
        let word = self.word();
        match word % 8 {
            0 => -0.0,
            1 => 0.0,
            2 => f64::NEG_INFINITY,
            3 => f64::from_bits(0x7ff8_0000_0000_0000 | self.word() >> 13), // a NaN with payload
            4 => f64::from_bits(self.word() >> 12),                         // subnormal
            _ => f64::from_bits(word),
        }
    }

    fn doubles<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.double())
    }

    /// Shifted by a random amount, so that varints of every length occur.
    fn count(&mut self) -> u64 {
        let shift = self.word() % 64;
        self.word() >> shift
    }

    fn tick(&mut self, tick: u64) -> TickRecord {
        TickRecord {
            tick,
            time_ns: self.count() >> 2,
            device_position: self.doubles(),
            device_orientation: self.doubles(),
            device_velocity: self.doubles(),
            device_angular_velocity: self.doubles(),
            tool_position: self.doubles(),
            tool_orientation: self.doubles(),
            force: self.doubles(),
            torque: self.doubles(),
            force_unlimited: self.doubles(),
            gap: self.double(),
            contacts: self.count() as u32,
            sweeps: self.count() as u32,
            residual: self.double(),
            snapshot_step: self.count(),
            snapshot_age: self.double(),
            flags: TickFlags(self.word() as u32),
            wake_latency_ns: self.count(),
            work_ns: self.count(),
            force_jump: self.double(),
            energy: self.double(),
            device_gripper: self.double(),
            tool_opening: self.double(),
            gripper_torque: self.double(),
            gripper_torque_unlimited: self.double(),
            torque_unlimited: self.doubles(),
            gripper_energy: self.double(),
            gripper_account: self.double(),
            gripper_withheld: self.double(),
            // Of either sign, the ends of the range among them.
            host_lead_ns: self.count().cast_signed(),
        }
    }

    fn step(&mut self, step: u64) -> StepRecord {
        StepRecord {
            step,
            time_ns: self.count() >> 2,
            dt: self.double(),
            assembly_ns: self.count(),
            free_motion_ns: self.count(),
            detection_ns: self.count(),
            compliance_ns: self.count(),
            solver_ns: self.count(),
            correction_ns: self.count(),
            snapshot_ns: self.count(),
            total_ns: self.count(),
            contacts: self.count() as u32,
            cg_iterations: self.count() as u32,
            cg_residual: self.double(),
            solver_sweeps: self.count() as u32,
            solver_residual: self.double(),
            worst_row: self.word() as i32,
            factor_epoch: self.count(),
            factor_age: self.double(),
            tool_force: self.doubles(),
            tool_torque: self.doubles(),
            inverted_elements: self.count() as u32,
            filtered_elements: self.count() as u32,
            flags: StepFlags(self.word() as u32),
            tool_position: self.doubles(),
            tool_orientation: self.doubles(),
            compliance_error: self.double(),
            sampled_error: self.double(),
            sampled_row: self.count() as u32,
            correction_iterations: self.count() as u32,
            overlap: self.double(),
            cuts: self.count() as u32,
            solver_attempts: self.count() as u32,
            phase: self.count() as u32,
            rung: self.count() as i32,
            lower_error: self.double(),
            tool_opening: self.double(),
            // All numbers but NaN, and nothing.
            force_error: Some(self.double()).filter(|error| !error.is_nan()),
        }
    }
}

/// Debug text with every double replaced by its bits: NaN equals itself and -0.0 differs from 0.0.
fn tick_bits(r: &TickRecord) -> Vec<u64> {
    let vectors = [r.device_position, r.device_velocity, r.device_angular_velocity, r.tool_position, r.force];
    let more = [r.torque, r.force_unlimited, [r.gap, r.residual, r.snapshot_age]];
    let orientations = r.device_orientation.iter().chain(&r.tool_orientation);
    let doubles = vectors.iter().chain(&more).flatten().chain(orientations).chain([&r.force_jump, &r.energy]);
    let counts = [r.tick, r.time_ns, r.contacts.into(), r.sweeps.into(), r.snapshot_step, r.flags.0.into()];
    doubles.map(|x| x.to_bits()).chain(counts).chain([r.wake_latency_ns, r.work_ns]).collect()
}

fn step_bits(r: &StepRecord) -> Vec<u64> {
    let doubles = [r.dt, r.cg_residual, r.solver_residual, r.factor_age];
    let vectors = [r.tool_force, r.tool_torque, r.tool_position];
    let doubles = doubles.iter().chain(vectors.iter().flatten()).chain(&r.tool_orientation).map(|x| x.to_bits());
    let durations = [r.assembly_ns, r.free_motion_ns, r.detection_ns, r.compliance_ns, r.solver_ns];
    let more = [r.correction_ns, r.snapshot_ns, r.total_ns, r.step, r.time_ns, r.factor_epoch];
    let counts =
        [r.contacts, r.cg_iterations, r.solver_sweeps, r.inverted_elements, r.filtered_elements, r.cuts, r.flags.0];
    let counts = counts.map(u64::from).into_iter().chain([
        r.worst_row as u64,
        r.solver_attempts.into(),
        r.phase.into(),
        r.rung as u64,
    ]);
    doubles.chain(durations).chain(more).chain(counts).collect()
}

fn read(bytes: Vec<u8>) -> Trace {
    let length = bytes.len() as u64;
    let (trace, damage) = Trace::collect(TraceReader::new(Cursor::new(bytes), length, "memory"));
    assert!(damage.is_none(), "{damage:?}");
    trace
}

#[test]
fn any_bits_come_back() {
    let mut bits = Bits(0x9e37_79b9_7f4a_7c15);
    let ticks: Vec<_> = (0..3000).map(|k| bits.tick(k)).collect();
    let steps: Vec<_> = (0..500).map(|k| bits.step(k)).collect();
    let mut writer = TraceWriter::new(Cursor::new(Vec::new()), &sample::config()).unwrap();
    for tick in &ticks {
        writer.write_tick(tick).unwrap();
    }
    for step in &steps {
        writer.write_step(step).unwrap();
    }
    let (sink, report, failure) = writer.finish();
    assert!(failure.is_none(), "{failure:?}");
    assert_eq!(report.bytes, sink.get_ref().len() as u64);
    assert_eq!(report.cut, 0);

    let trace = read(sink.into_inner());
    assert_eq!(trace.ticks.len(), ticks.len());
    assert_eq!(trace.steps.len(), steps.len());
    for (read, written) in trace.ticks.iter().zip(&ticks) {
        assert_eq!(tick_bits(read), tick_bits(written));
    }
    assert!(steps.iter().any(|step| step.force_error.is_none()) && steps.iter().any(|step| step.force_error.is_some()));
    for (read, written) in trace.steps.iter().zip(&steps) {
        assert_eq!(step_bits(read), step_bits(written));
        assert_eq!(read.force_error.map(f64::to_bits), written.force_error.map(f64::to_bits));
    }
}

#[test]
fn rigid_bodies_come_back_to_the_bit_with_their_frames_and_shapes() {
    let config = palpate_trace::TraceConfig { solids: sample::solids(), ..sample::config() };
    let mut writer = TraceWriter::new(Cursor::new(Vec::new()), &config).unwrap();
    (0..40).for_each(|k| writer.write_rigid(&sample::rigid(k)).unwrap());
    // A body that the trace was not told of has no name, and so no frame.
    writer.write_rigid(&palpate_trace::RigidRecord { body: 7, ..sample::rigid(40) }).unwrap();
    let (sink, report, failure) = writer.finish();
    assert!(failure.is_none(), "{failure:?}");
    let count = |topic| report.messages.iter().find(|(t, _)| *t == topic).map(|(_, count)| *count);
    assert_eq!([Topic::RigidState, Topic::Transforms, Topic::BodyShapes].map(count), [Some(41), Some(40), Some(1)]);
    let trace = read(sink.into_inner());
    assert_eq!(trace.rigid.len(), 41);
    assert!(trace.rigid.iter().take(40).zip(0..).all(|(body, k)| body.same_bits(&sample::rigid(k))));
}

#[test]
fn factors_log_metadata_and_attachments_come_back() {
    let mut config = sample::config();
    config.start_unix_ns = 1_790_000_000_123_456_789;
    let factors = [FactorStatus::Unknown, FactorStatus::Ready, FactorStatus::Indefinite, FactorStatus::NonFinite]
        .map(|status| FactorRecord { epoch: u64::MAX, taken_step: 3, status, ..sample::factor(2) });
    let lines =
        [LogLevel::Unknown, LogLevel::Debug, LogLevel::Info, LogLevel::Warning, LogLevel::Error, LogLevel::Fatal]
            .map(|level| LogRecord::new(42, level, "step", "body 'liver' turned non-finite: rolled back"));
    let mut writer = TraceWriter::new(Cursor::new(Vec::new()), &config).unwrap();
    factors.iter().for_each(|factor| writer.write_factor(factor).unwrap());
    lines.iter().for_each(|line| writer.write_log(line).unwrap());
    let trace = read(writer.finish().0.into_inner());

    assert_eq!(trace.factors, factors);
    assert_eq!(trace.log, lines, "log times are relative to the start of the run");
    assert_eq!(trace.attachments, config.attachments);
    assert_eq!(trace.attachment("scene.toml"), Some(&config.attachments[0].data[..]));
    assert_eq!(trace.attachment("other.toml"), None);
    let engine = &trace.metadata["engine"];
    assert_eq!(engine["start_unix_ns"], "1790000000123456789");
    assert!(config.engine.iter().all(|(key, value)| engine.get(key) == Some(value)));
}

#[test]
fn equal_lockstep_runs_give_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str| {
        let path = folder.path().join(name);
        let (mut trace, mut ticks, mut steps, mut factors) = InlineTrace::create(&path, &sample::config()).unwrap();
        for k in 0..60 {
            assert!(sample::push_step(k, &mut ticks, &mut steps, &mut factors));
            trace.drain();
        }
        let summary = trace.finish();
        assert!(summary.failure.is_none(), "{summary}");
        std::fs::read(path).unwrap()
    };
    let first = write("first.mcap");
    assert!(first == write("second.mcap"), "the same records gave other bytes");
}

#[test]
fn poses_and_geometry_are_decimated_and_counted() {
    let config = sample::config();
    let (mut trace, mut ticks, mut steps, mut factors) =
        InlineTrace::with_sink(Cursor::new(Vec::new()), &config).unwrap();
    for k in 0..30 {
        assert!(sample::push_step(k, &mut ticks, &mut steps, &mut factors));
        trace.drain();
    }
    let (sink, summary) = trace.finish_into_sink();
    let count = |topic| summary.messages.iter().find(|(t, _)| *t == topic).map(|(_, count)| *count);
    assert_eq!(count(Topic::HapticSample), Some(990));
    assert_eq!(count(Topic::ToolPose), Some(99));
    assert_eq!(count(Topic::Transforms), Some(99));
    assert_eq!(count(Topic::TissueSurface), Some(15));
    assert_eq!(count(Topic::TissueNodes), Some(15));
    assert_eq!(count(Topic::ToolShape), Some(1));
    assert_eq!(count(Topic::Factor), Some(10));

    let read = read(sink.unwrap().into_inner());
    assert_eq!((read.ticks.len(), read.steps.len(), read.factors.len()), (990, 30, 10));
    for (topic, messages) in summary.messages {
        let own = [Topic::HapticSample, Topic::Step, Topic::RigidState, Topic::Factor, Topic::Log].contains(&topic);
        assert_eq!(read.others.get(topic.name()).copied(), (!own).then_some(messages), "{topic:?}");
    }
}
