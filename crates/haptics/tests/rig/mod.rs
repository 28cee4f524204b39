//! A wall, a device and a tick: what most tests of the loop need.
#![allow(dead_code)] // each test file uses its part

use nalgebra::{Isometry3, Vector3};
use palpate_constraints::law::{Coulomb, Law, Signorini};
use palpate_haptics::device::{DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::exchange::{Reader, Writer, latest};
use palpate_haptics::record::TickRecord;
use palpate_haptics::run::run_tick;
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};
use palpate_haptics::tick::{Tick, TickConfig, TickState, TickWorkspace};

pub(crate) const PERIOD: f64 = 1e-3;
/// Ticks of one step at 30 Hz.
pub(crate) const TICKS_PER_STEP: u64 = 33;

/// A plane through the origin that pushes the tool along `normal`, with compliance `w` in all directions (m/N).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wall {
    pub(crate) normal: Vector3<f64>,
    pub(crate) offset: f64,
    pub(crate) w: f64,
    pub(crate) friction: Option<f64>,
}

impl Wall {
    pub(crate) fn floor(w: f64) -> Self {
        Self { normal: Vector3::z(), offset: 0.0, w, friction: None }
    }

    pub(crate) fn with_friction(self, friction: f64) -> Self {
        Self { friction: Some(friction), ..self }
    }
}

/// Fills `snapshot` with these walls, seen from `tool_pose`; the tangential gap is zero there.
pub(crate) fn fill(snapshot: &mut HapticSnapshot, step: u64, walls: &[Wall], tool_pose: &Isometry3<f64>) {
    snapshot.clear();
    for (i, wall) in walls.iter().enumerate() {
        let gap = wall.normal.dot(&tool_pose.translation.vector) - wall.offset;
        let n = wall.normal;
        let t = n.cross(&if n.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }).normalize();
        let frame = [n, t, n.cross(&t)].map(|d| [d.x, d.y, d.z, 0.0, 0.0, 0.0]);
        let law: Law = wall.friction.map_or(Signorini.into(), |friction| Coulomb { friction }.into());
        let rows = law.rows();
        let delta_free = [gap, 0.0, 0.0];
        let (tool_rows, delta_free) = (&frame[..rows], &delta_free[..rows]);
        let contact = SnapshotContact { law, feature: i as u64 + 1, tool_rows, delta_free, lambda: &[0.0; 3][..rows] };
        assert!(snapshot.push(&contact));
    }
    let rows = snapshot.rows();
    let compliances: Vec<f64> =
        walls.iter().flat_map(|w| vec![w.w; if w.friction.is_some() { 3 } else { 1 }]).collect();
    let w = snapshot.compliance_mut();
    w.fill(0.0);
    for (row, c) in compliances.iter().enumerate() {
        w[row * rows + row] = *c;
    }
    (snapshot.step, snapshot.dt, snapshot.valid, snapshot.tool_pose) = (step, 1.0 / 30.0, true, *tool_pose);
}

pub(crate) fn snapshot_of(step: u64, walls: &[Wall], tool_pose: &Isometry3<f64>) -> HapticSnapshot {
    let mut snapshot = HapticSnapshot::new(8);
    fill(&mut snapshot, step, walls, tool_pose);
    snapshot
}

pub(crate) fn at(position: Vector3<f64>) -> DeviceSample {
    DeviceSample::at_rest(0.0, Isometry3::translation(position.x, position.y, position.z))
}

/// A tick with its state and workspace, and no device.
pub(crate) struct Bench {
    pub(crate) tick: Tick,
    pub(crate) state: TickState,
    pub(crate) ws: TickWorkspace,
    pub(crate) index: u64,
}

impl Bench {
    pub(crate) fn new(config: &TickConfig, spec: &DeviceSpec) -> Self {
        let tick = Tick::new(config, spec).expect("valid configuration");
        Self { tick, state: TickState::new(8), ws: TickWorkspace::new(8), index: 0 }
    }

    /// The defaults on a strong device that only the scene limits, with snapshots that do not grow stale.
    pub(crate) fn strong() -> Self {
        let spec = strong_spec();
        Self::new(&patient(&spec), &spec)
    }

    pub(crate) fn tick(&mut self, snapshot: &HapticSnapshot, sample: &DeviceSample) -> TickRecord {
        let time = TickTime::regular(self.index, PERIOD);
        self.index += 1;
        self.tick.tick(&mut self.state, snapshot, sample, time, &mut self.ws)
    }

    /// Ticks until the fade-in is over.
    pub(crate) fn warm_up(&mut self, snapshot: &HapticSnapshot, sample: &DeviceSample) -> TickRecord {
        (0..400).map(|_| self.tick(snapshot, sample)).last().expect("ticks")
    }
}

/// The defaults, but that snapshots do not grow stale.
pub(crate) fn patient(spec: &DeviceSpec) -> TickConfig {
    let mut config = TickConfig::for_device(spec);
    (config.limits.stale_after, config.limits.stale_zero) = (1e3, 2e3);
    config
}

pub(crate) fn strong_spec() -> DeviceSpec {
    DeviceSpec { max_force: 1e3, max_torque: 1e2, ..DeviceSpec::virtual_device(0.0) }
}

/// The closed loop: device, tick, and a step that shows the same walls from the tool's latest pose every 33 ticks.
pub(crate) struct Loop<D: HapticDevice> {
    pub(crate) device: D,
    pub(crate) bench: Bench,
    pub(crate) walls: Vec<Wall>,
    writer: Writer<HapticSnapshot>,
    reader: Reader<HapticSnapshot>,
    tool_pose: Isometry3<f64>,
}

impl<D: HapticDevice> Loop<D> {
    pub(crate) fn new(device: D, walls: Vec<Wall>) -> Self {
        let config = TickConfig::for_device(device.spec());
        Self::with_config(device, walls, &config)
    }

    pub(crate) fn with_config(device: D, walls: Vec<Wall>, config: &TickConfig) -> Self {
        let bench = Bench::new(config, device.spec());
        let (writer, reader) = latest(&HapticSnapshot::new(8));
        Self { device, bench, walls, writer, reader, tool_pose: Isometry3::identity() }
    }

    pub(crate) fn tick(&mut self) -> TickRecord {
        let index = self.bench.index;
        if index % TICKS_PER_STEP == 1 {
            fill(self.writer.value_mut(), index / TICKS_PER_STEP + 1, &self.walls, &self.tool_pose);
            self.writer.publish();
        }
        self.bench.index += 1;
        let Bench { tick, state, ws, .. } = &mut self.bench;
        let time = TickTime::regular(index, PERIOD);
        let record = run_tick(tick, state, ws, &mut self.reader, &mut self.device, time);
        self.tool_pose = record.tool_pose;
        record
    }
}
