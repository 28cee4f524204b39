//! A device, a clock and steps that fail now and then, by a schedule: what the proofs of the real-time rule run on.
#![allow(dead_code)] // each test file uses its part

use nalgebra::{Isometry3, Matrix3, Vector3};
use palpate_collision::tool::Hinge;
use palpate_constraints::law::Signorini;
use palpate_haptics::body_contact::{BodyContact, ToolPart};
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime, VirtualDevice};
use palpate_haptics::record::TickFlags;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::wrench::Wrench;

/// Contacts of bodies that a snapshot has room for.
pub(crate) const BODIES: usize = 4;

/// The virtual device with faults at stated ticks, and with a gripper that opens and closes.
pub(crate) struct Faulty {
    inner: VirtualDevice,
    tick: u64,
}

impl Faulty {
    pub(crate) fn new(inner: VirtualDevice) -> Self {
        Self { inner, tick: 0 }
    }
}

impl HapticDevice for Faulty {
    fn spec(&self) -> &DeviceSpec {
        self.inner.spec()
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        self.tick = tick.index;
        let mut sample = self.inner.read(tick)?;
        sample.gripper = 0.5 + 0.5 * (0.01 * tick.index as f64).sin();
        match tick.index % 17_000 {
            9_000 => return Err(DeviceError::Timeout),
            11_000 => sample.velocity.linear.y = f64::NAN,
            13_000 => sample.pose = Isometry3::translation(f64::NAN, 0.0, 0.0),
            14_000 => sample.gripper = f64::NAN,
            15_000 => sample.pose.translation.z -= 0.1,
            _ => {}
        }
        Ok(sample)
    }

    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if self.tick % 21_000 == 15_500 { Err(DeviceError::Driver(7)) } else { self.inner.write(wrench) }
    }

    fn close(&mut self) {
        self.inner.close();
    }
}

/// Time of tick `index`: of a clock of 1 kHz by which now and then a tick comes late, very late, or before the one before.
pub(crate) fn time(index: u64) -> TickTime {
    let dt = match index % 50_000 {
        31_000 => 3e-3,
        43_210 => 0.2,
        47_000 => -1e-3,
        _ => 1e-3,
    };
    TickTime { dt, ..TickTime::regular(index, 1e-3) }
}

/// The step that tick `index` comes after, if it is a new one: each takes 33 ms, and some stall for a second.
pub(crate) fn step(index: u64) -> Option<u64> {
    (index % 33 == 1 && index % 40_000 < 39_000).then_some(index / 33 + 1)
}

/// Hinge of the tool's jaws.
pub(crate) fn hinge() -> Hinge {
    Hinge { pivot: Vector3::zeros(), axis: Vector3::x_axis(), closed: 0.0, open: 0.6 }
}

/// A wall above or beside the tool whose contact also opens the jaws, and which is met by the tool alone.
pub(crate) fn body(feature: u64, gap: f64) -> BodyContact {
    BodyContact {
        feature: feature << 52,
        law: Signorini.into(),
        frame: Matrix3::from_columns(&[-Vector3::z(), Vector3::x(), -Vector3::y()]),
        tool: Some(ToolPart { lever: -Vector3::z() * 5e-3, opens: Vector3::z() * 0.02 }),
        gap,
        free: Vector3::new(gap, 0.0, 0.0),
        drift: Vector3::zeros(),
        flow: Vector3::zeros(),
        force: Vector3::zeros(),
    }
}

/// The same snapshot with room for contacts of bodies, and with `bodies` of them.
pub(crate) fn with_bodies(plain: &HapticSnapshot, contacts: usize, nodes: usize, bodies: u64) -> HapticSnapshot {
    let mut snapshot = HapticSnapshot::with_bodies(contacts, nodes, BODIES);
    assert!(snapshot.copy_from(plain));
    (0..bodies).for_each(|k| assert!(snapshot.patch.bodies.push(body(k + 1, 1e-3 * (k as f64 - 1.0)), false)));
    snapshot
}

/// What the schedule must have brought about.
pub(crate) const HAPPENS: [TickFlags; 14] = [
    TickFlags::NEW_SNAPSHOT,
    TickFlags::INVALID_SNAPSHOT,
    TickFlags::STALE,
    TickFlags::FADE_IN,
    TickFlags::NON_FINITE,
    TickFlags::DEVICE_ERROR,
    TickFlags::GAP,
    TickFlags::TRUNCATED,
    TickFlags::BAD_POSE,
    TickFlags::LOCAL,
    TickFlags::BEYOND_PATCH,
    TickFlags::PASSIVITY,
    TickFlags::LATE,
    TickFlags::JUMPED,
];

/// The flags that were seen, each how often.
#[derive(Debug, Default)]
pub(crate) struct Seen(pub(crate) [u32; TickFlags::COUNT]);

impl Seen {
    pub(crate) fn add(&mut self, flags: TickFlags) {
        for (bit, count) in self.0.iter_mut().enumerate() {
            *count += flags.bits() >> bit & 1;
        }
    }

    /// Names of those that should have been and were not.
    pub(crate) fn missing(&self) -> Vec<&'static str> {
        let unseen = |flag: &&TickFlags| self.0[flag.bits().trailing_zeros() as usize] == 0;
        HAPPENS.iter().filter(unseen).flat_map(|flag| flag.names()).collect()
    }
}
