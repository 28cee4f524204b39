//! The real-time rule, held by an allocator that counts: no allocation and no release of memory in any tick.
#![allow(clippy::print_stdout)] // what was measured, for `--nocapture`

mod rig;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use nalgebra::{Isometry3, Vector3};
use palpate_constraints::law::{Coulomb, Signorini};
use palpate_haptics::device::{
    DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime, VirtualDevice, VirtualDeviceConfig,
};
use palpate_haptics::exchange::{every, latest};
use palpate_haptics::hand::Hand;
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::run::run_tick;
use palpate_haptics::script::HandScript;
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};
use palpate_haptics::tick::{Tick, TickConfig, TickState, TickWorkspace};
use palpate_haptics::wrench::Wrench;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const CAPACITY: usize = 24;

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
        if tick.index % 1700 == 900 {
            return Err(DeviceError::Timeout);
        }
        if tick.index % 1300 == 1000 {
            sample.pose = Isometry3::translation(f64::NAN, 0.0, 0.0);
        }
        Ok(sample)
    }

    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if self.tick % 2100 == 1500 { Err(DeviceError::Driver(7)) } else { self.inner.write(wrench) }
    }

    fn close(&mut self) {
        self.inner.close();
    }
}

/// A bed of springs under the tool: as many contacts as the step says, some with friction, coupled like an elastic
/// half-space, with features that come and go.
fn fill(snapshot: &mut HapticSnapshot, step: u64) {
    snapshot.clear();
    let contacts = (step * 7 % (CAPACITY as u64 + 6)) as usize;
    for i in 0..contacts {
        let x = 1e-3 * i as f64;
        let rows = [[0.0, 0.0, 1.0, 0.0, -x, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0, x]];
        let law = if i % 3 == 0 { Signorini.into() } else { Coulomb { friction: 0.3 }.into() };
        let n = if i % 3 == 0 { 1 } else { 3 };
        let feature = (i as u64 * 5 + step / 3) % 40;
        let delta_free = [1e-4 * (i as f64 - 3.0), 0.0, 0.0];
        let contact = SnapshotContact {
            law,
            feature,
            tool_rows: &rows[..n],
            delta_free: &delta_free[..n],
            lambda: &[0.01, 0.0, 0.0][..n],
        };
        // Past the capacity this is refused and counted.
        snapshot.push(&contact);
    }
    let rows = snapshot.rows();
    for (k, w) in snapshot.compliance_mut().iter_mut().enumerate() {
        let distance = (k / rows).abs_diff(k % rows) as f64;
        *w = 1e-3 * (-0.7 * distance).exp();
    }
    (snapshot.step, snapshot.valid) = (step, step % 29 != 17);
    if step % 31 == 5 {
        snapshot.compliance_mut().fill(f64::NAN);
    }
}

#[test]
fn twenty_thousand_ticks_with_contacts_and_faults_allocate_nothing() {
    // The counter counts, or the rest would prove nothing.
    assert_no_alloc(|| drop(std::hint::black_box(vec![0_u8; 64])));
    assert!(violation_count() >= 2, "an allocation and a release went unseen");
    reset_violation_count();

    let hand = Hand::preset("fingertip").unwrap();
    let script = HandScript::at(Vector3::z() * 2e-3).stroke(Vector3::new(4e-3, 0.0, -6e-3), 1.0, 20).unwrap();
    let inner = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script).unwrap();
    let mut device = Faulty { inner, tick: 0 };
    let tick = Tick::new(&TickConfig::for_device(device.spec()), device.spec()).unwrap();
    let (mut state, mut ws) = (TickState::new(CAPACITY), TickWorkspace::new(CAPACITY));
    let (mut writer, mut reader) = latest(&HapticSnapshot::new(CAPACITY));
    let (mut records, mut recorded) = every::<TickRecord>(64);

    let mut seen = [0_u32; 14];
    let (mut pressed, mut previous, mut came, mut went) = (0, 0, 0, 0);
    for index in 0..20_000_u64 {
        // The step stalls for half a second now and then.
        if index % 33 == 1 && index % 4000 < 3400 {
            assert_no_alloc(|| {
                fill(writer.value_mut(), index / 33 + 1);
                writer.publish();
            });
        }
        let late = if index % 5000 == 4321 { 0.2 } else { rig::PERIOD };
        let time = TickTime { dt: late, ..TickTime::regular(index, rig::PERIOD) };
        assert_no_alloc(|| {
            let record = run_tick(&tick, &mut state, &mut ws, &mut reader, &mut device, time);
            records.send(record);
        });
        let record = recorded.receive().unwrap();
        assert!(record.wrench.is_finite() && record.wrench.force.norm() <= tick.limits().max_force() + 1e-12);
        for (bit, count) in seen.iter_mut().enumerate() {
            *count += record.flags.bits() >> bit & 1;
        }
        pressed += u32::from(record.active > 0);
        came += u32::from(record.active > previous);
        went += u32::from(record.active < previous);
        previous = record.active;
    }
    println!("flags seen {seen:?}; contact in {pressed} ticks, gained in {came}, lost in {went}");
    assert_eq!(violation_count(), 0, "the tick touched the allocator");
    // The run went where it was meant to go.
    assert!(pressed > 5000 && came > 100 && went > 100);
    let happened = [
        TickFlags::NEW_SNAPSHOT,
        TickFlags::INVALID_SNAPSHOT,
        TickFlags::STALE,
        TickFlags::FADE_IN,
        TickFlags::NON_FINITE,
        TickFlags::DEVICE_ERROR,
        TickFlags::GAP,
        TickFlags::BAD_POSE,
    ];
    assert!(happened.iter().all(|flag| seen[flag.bits().trailing_zeros() as usize] > 0), "{seen:?}");
}

#[test]
fn a_late_device_in_a_hand_that_gives_way_allocates_nothing() {
    // Every tick has another length, hence another motion between ticks to prepare.
    let mechanics = VirtualDeviceConfig { jitter: 3e-4, ..VirtualDeviceConfig::default() };
    let script = HandScript::at(Vector3::zeros()).stroke(Vector3::z() * -6e-3, 1.0, 2).unwrap().let_go(0.5).unwrap();
    let mut device = VirtualDevice::new(mechanics, Hand::preset("normal").unwrap(), script).unwrap();
    reset_violation_count();
    for index in 0..3000 {
        assert_no_alloc(|| {
            let sample = device.read(TickTime::regular(index, rig::PERIOD));
            let depth = sample.map_or(0.0, |sample| sample.pose.translation.z.min(0.0));
            let _ = device.write(Wrench::from_force(Vector3::z() * (-300.0 * depth)));
        });
    }
    assert_eq!(violation_count(), 0);
}
