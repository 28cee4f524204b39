//! Records for tests and the example: a probe that presses a tetrahedron, with every field in use.

#![allow(dead_code)] // each test uses its part

use palpate_trace::{
    Attachment, BodyGeometry, FactorRecord, FactorStatus, FactorTrace, LogLevel, LogRecord, Offer, RigidRecord,
    SolidGeometry, StepFlags, StepRecord, StepTrace, TickFlags, TickRecord, TickTrace, ToolShape, TraceConfig,
};

pub(crate) const TICKS_PER_STEP: u64 = 33;
const TICK_NS: u64 = 1_000_000;

/// One tetrahedron of 2 cm, a probe of 5 mm, a scene.
pub(crate) fn config() -> TraceConfig {
    let corner = 0.02;
    let rest = vec![[0.0; 3], [corner, 0.0, 0.0], [0.0, corner, 0.0], [0.0, 0.0, corner]];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    TraceConfig {
        engine: [("version", "0.1.0"), ("scene", "sample"), ("seed", "7")]
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
            .into(),
        attachments: vec![Attachment {
            name: "scene.toml".into(),
            media_type: "application/toml".into(),
            data: b"[world]\nstep = 0.033\n".to_vec(),
        }],
        bodies: vec![BodyGeometry::new("tetrahedron", rest, triangles)],
        tool: Some(ToolShape::Capsule { a: [0.0; 3], b: [0.0, 0.0, 0.04], radius: 0.005 }),
        ..TraceConfig::default()
    }
}

pub(crate) fn tick(tick: u64) -> TickRecord {
    let time = tick as f64 * 1e-3;
    let depth = 0.01 * (3.0 * time).sin();
    let half_turn = 0.25 * time;
    TickRecord {
        tick,
        time_ns: tick * TICK_NS,
        device_position: [0.001 * time, -0.0, 0.03 - depth],
        device_orientation: [0.0, half_turn.sin(), 0.0, half_turn.cos()],
        device_velocity: [0.001, 0.0, -0.03 * (3.0 * time).cos()],
        device_angular_velocity: [0.0, 0.5, 0.0],
        tool_position: [0.001 * time, 0.0, 0.03 - 0.9 * depth],
        tool_orientation: [0.0, half_turn.sin(), 0.0, half_turn.cos()],
        force: [-0.0, 0.1 * depth, 300.0 * depth.max(0.0)],
        torque: [0.0, -1e-3 * depth, 0.0],
        force_unlimited: [-0.0, 0.1 * depth, 310.0 * depth.max(0.0)],
        gap: if depth > 0.0 { -depth } else { f64::NAN },
        contacts: if depth > 0.0 { 3 } else { 0 },
        sweeps: 4,
        residual: 1e-9 * time,
        snapshot_step: tick / TICKS_PER_STEP,
        snapshot_age: (tick % TICKS_PER_STEP) as f64 * 1e-3,
        flags: if depth > 0.009 { TickFlags::FORCE_LIMITED | TickFlags::FADING } else { TickFlags::default() },
        wake_latency_ns: 0,
        work_ns: 0,
        force_jump: if tick.is_multiple_of(TICKS_PER_STEP) { 0.02 } else { 0.0 },
        energy: 1e-3 * depth.max(0.0),
        device_gripper: 1.0 - 0.1 * time,
        tool_opening: 0.5 - 0.05 * time,
        gripper_torque: 0.01 * depth,
        gripper_torque_unlimited: 0.011 * depth,
        torque_unlimited: [0.0, -2e-3 * depth, 0.0],
        gripper_energy: 2e-4 * time,
        gripper_account: 1e-4 * depth,
        gripper_withheld: 1e-3 * depth.max(0.0),
        host_lead_ns: 40_000 * (tick % 5) as i64 - 90_000,
    }
}

pub(crate) fn step(step: u64) -> StepRecord {
    let time = step as f64 * 0.033;
    StepRecord {
        step,
        time_ns: (step + 1) * TICKS_PER_STEP * TICK_NS,
        dt: 0.033,
        contacts: 3,
        cg_iterations: 8,
        cg_residual: 3.5e-4,
        solver_sweeps: 12,
        solver_residual: 2e-9,
        worst_row: if step == 0 { -1 } else { 4 },
        factor_epoch: 1 + step / 3,
        factor_age: 0.1 * (step % 3) as f64,
        tool_force: [0.0, 0.0, -time],
        tool_torque: [1e-4, -0.0, 0.0],
        inverted_elements: 0,
        filtered_elements: 5,
        flags: if step % 7 == 6 { StepFlags::FACTOR_REFUSED } else { StepFlags::default() },
        tool_position: [0.0, 0.0, 0.03],
        tool_orientation: [0.0, 0.0, 0.0, 1.0],
        compliance_error: 0.03,
        sampled_error: 0.04,
        sampled_row: 4,
        correction_iterations: 6,
        overlap: 2e-5,
        force_error: (step > 2).then_some(0.01),
        ..StepRecord::default()
    }
}

pub(crate) fn factor(epoch: u64) -> FactorRecord {
    let taken_step = 3 * (epoch - 1);
    FactorRecord {
        epoch,
        time_ns: (taken_step + 3) * TICKS_PER_STEP * TICK_NS,
        taken_ns: taken_step * TICKS_PER_STEP * TICK_NS,
        taken_step,
        duration_ns: 0,
        status: if epoch == 2 { FactorStatus::Indefinite } else { FactorStatus::Ready },
    }
}

/// Node positions of [`config`]'s body: its tip sinks.
pub(crate) fn positions(step: u64) -> [f64; 12] {
    let mut positions = [0.0; 12];
    positions[3] = 0.02;
    positions[7] = 0.02;
    positions[11] = 0.02 - 1e-4 * step as f64;
    positions
}

/// Pushes one step: its ticks, its report, its geometry, a factor every third.
pub(crate) fn push_step(k: u64, ticks: &mut TickTrace, steps: &mut StepTrace, factors: &mut FactorTrace) -> bool {
    let mut taken = true;
    for n in k * TICKS_PER_STEP..(k + 1) * TICKS_PER_STEP {
        taken &= ticks.push(tick(n));
    }
    let record = step(k);
    taken &= steps.push(record);
    taken &= steps.push_positions(record.time_ns, None, |out| out.copy_from_slice(&positions(k))) != Offer::Dropped;
    if k % 3 == 2 {
        taken &= factors.push(factor(1 + k / 3));
    }
    if k.is_multiple_of(30) {
        let line = LogRecord::new(record.time_ns, LogLevel::Info, "step", "the probe presses the tetrahedron, µ = 0.3");
        taken &= steps.log(line);
    }
    taken
}

/// A floor and a ball that rolls on it.
pub(crate) fn solids() -> Vec<SolidGeometry> {
    let at = |z: f64| ([0.0, 0.0, z], [0.0, 0.0, 0.0, 1.0]);
    let corners = vec![[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 0.0]];
    let floor = ToolShape::Mesh { vertices: corners, triangles: vec![[0, 1, 2]] };
    vec![
        SolidGeometry { name: "floor".into(), shape: floor, pose: at(-0.01), moves: false },
        SolidGeometry { name: "ball".into(), shape: ToolShape::Sphere { radius: 0.01 }, pose: at(0.0), moves: true },
    ]
}

/// Where the ball of [`solids`] is after a step.
pub(crate) fn rigid(step: u64) -> RigidRecord {
    let time = step as f64 * 0.033;
    RigidRecord {
        step,
        time_ns: (step + 1) * TICKS_PER_STEP * TICK_NS,
        body: 0,
        position: [0.1 * time, -0.0, f64::NAN],
        orientation: [0.0, (5.0 * time).sin(), 0.0, (5.0 * time).cos()],
        velocity: [0.1, f64::MIN_POSITIVE / 3.0, 0.0],
        angular_velocity: [0.0, 10.0, -0.0],
    }
}
