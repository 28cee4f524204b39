//! The real-time rule on patches of tissue, held by an allocator that counts, over a million ticks.
#![allow(clippy::print_stdout)] // what was measured, for `--nocapture`

mod sheet;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use nalgebra::{Isometry3, Vector3};
use palpate_haptics::device::{
    DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime, VirtualDevice, VirtualDeviceConfig,
};
use palpate_haptics::exchange::{every, latest};
use palpate_haptics::hand::Hand;
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::run::run_tick;
use palpate_haptics::script::HandScript;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::{PatchTickConfig, Tick, TickConfig};
use palpate_haptics::wrench::Wrench;
use sheet::{Ball, Sheet, pose};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const TICKS: u64 = 1_000_000;

/// Nodes of the patches: few, since there are many ticks.
const NODES: usize = 16;

/// The virtual device with faults at stated ticks.
struct Faulty {
    inner: VirtualDevice,
    tick: u64,
}

impl HapticDevice for Faulty {
    fn spec(&self) -> &DeviceSpec {
        self.inner.spec()
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        self.tick = tick.index;
        let mut sample = self.inner.read(tick)?;
        match tick.index % 17_000 {
            9_000 => return Err(DeviceError::Timeout),
            13_000 => sample.pose = Isometry3::translation(f64::NAN, 0.0, 0.0),
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

/// Snapshots as steps make them: the sheet breathes, patches are gathered about several places, some are poisoned or bare.
fn variants(ball: &Ball) -> Vec<HapticSnapshot> {
    (0..24_u32)
        .map(|k| {
            let along = Vector3::new(4e-3 * f64::from(k % 3), 3e-3 * f64::from(k % 2), 5e-3);
            let sheet = Sheet {
                friction: if k % 5 == 0 { 0.0 } else { 0.4 },
                coupling: 0.3,
                lift: Vector3::z() * 2e-4 * f64::from(k % 4),
                max_nodes: NODES,
                ..Sheet::springs(2e-3)
            };
            let mut snapshot = sheet.snapshot(0, ball, &pose(along));
            match k {
                7 => snapshot.patch.compliance_mut().fill(f64::NAN),
                11 => snapshot.patch.q_free_mut().fill(Vector3::repeat(f64::INFINITY)),
                13 => snapshot.valid = false,
                17 => snapshot.patch.valid = false,
                _ => {}
            }
            snapshot
        })
        .collect()
}

#[test]
fn a_million_ticks_on_patches_with_faults_allocate_nothing() {
    // The counter counts, or the rest would prove nothing.
    assert_no_alloc(|| drop(std::hint::black_box(vec![0_u8; 64])));
    assert!(violation_count() >= 2, "an allocation and a release went unseen");
    reset_violation_count();

    let ball = Ball::at_nodes(5e-3);
    let variants = variants(&ball);
    let hand = Hand::preset("fingertip").unwrap();
    let script = HandScript::at(Vector3::z() * 9e-3).stroke(Vector3::new(6e-3, 2e-3, -7e-3), 1.0, 1000).unwrap();
    let inner = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script).unwrap();
    let mut device = Faulty { inner, tick: 0 };
    let patch = PatchTickConfig {
        tool: ball.shape.clone().into(),
        detection: ball.detection,
        max_nodes: NODES,
        max_bodies: 0,
        hand_over: PatchTickConfig::HAND_OVER,
    };
    let config = TickConfig { tolerance: 1e-3, ..TickConfig::for_device(device.spec()) };
    let tick = Tick::new(&config, device.spec()).and_then(|tick| tick.on_patches(patch)).unwrap();
    let (mut state, mut ws) = (tick.state(NODES), tick.workspace(NODES));
    let (mut writer, mut reader) = latest(&HapticSnapshot::with_patch(40, NODES));
    let (mut records, mut recorded) = every::<TickRecord>(64);

    let mut seen = [0_u32; TickFlags::COUNT];
    let (mut pressed, mut previous, mut changed) = (0_u32, 0, 0_u32);
    let mut before = Vector3::zeros();
    for index in 0..TICKS {
        // The step stalls for a second now and then.
        if index % 33 == 1 && index % 40_000 < 39_000 {
            assert_no_alloc(|| {
                let step = index / 33 + 1;
                let snapshot = writer.value_mut();
                // Faults are rare: most of the time the same sound places take turns.
                let which = if step % 40 < 24 { step % 40 } else { step % 6 };
                assert!(snapshot.copy_from(&variants[which as usize]));
                snapshot.step = step;
                writer.publish();
            });
        }
        // Now and then a tick comes late, or the clock goes backwards.
        let dt = match index % 50_000 {
            43_210 => 0.2,
            47_000 => -1e-3,
            _ => 1e-3,
        };
        let time = TickTime { dt, ..TickTime::regular(index, 1e-3) };
        assert_no_alloc(|| {
            let record = run_tick(&tick, &mut state, &mut ws, &mut reader, &mut device, time);
            records.send(record);
        });
        let record = recorded.receive().unwrap();
        assert!(record.wrench.is_finite() && record.wrench.force.norm() <= tick.limits().max_force() + 1e-12);
        // It changes by the slew at most, or ends at once where a number or the device is at fault.
        let change = (record.wrench.force - before).norm();
        assert!(change <= 2.0 + 1e-9 || record.wrench.force == Vector3::zeros() || dt != 1e-3, "{index}: {change} N");
        before = record.wrench.force;
        for (bit, count) in seen.iter_mut().enumerate() {
            *count += record.flags.bits() >> bit & 1;
        }
        pressed += u32::from(record.active > 0);
        changed += u32::from(record.active != previous);
        previous = record.active;
    }
    println!("flags seen {seen:?}; contact in {pressed} ticks, changes of their number in {changed}");
    assert_eq!(violation_count(), 0, "the tick touched the allocator");
    assert!(pressed > 300_000 && changed > 5_000, "{pressed} {changed}");
    let happened = [
        TickFlags::NEW_SNAPSHOT,
        TickFlags::INVALID_SNAPSHOT,
        TickFlags::STALE,
        TickFlags::FADE_IN,
        TickFlags::NON_FINITE,
        TickFlags::DEVICE_ERROR,
        TickFlags::GAP,
        TickFlags::BAD_POSE,
        TickFlags::LOCAL,
        TickFlags::BEYOND_PATCH,
    ];
    assert!(happened.iter().all(|flag| seen[flag.bits().trailing_zeros() as usize] > 0), "{seen:?}");
}
