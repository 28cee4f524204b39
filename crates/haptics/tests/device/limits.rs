//! Limits, fades and faults: the force stays finite and bounded, and comes and goes smoothly.

use crate::rig::{Bench, PERIOD, Wall, at, patient, snapshot_of, strong_spec};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, ScriptedDevice, TickTime};
use palpate_haptics::exchange::latest;
use palpate_haptics::limits::{Limits, LimitsConfig, LimitsState};
use palpate_haptics::record::TickFlags;
use palpate_haptics::run::run_tick;
use palpate_haptics::script::HandScript;
use palpate_haptics::tick::TickConfig;
use palpate_haptics::wrench::{Twist, Wrench};

const DEPTH: f64 = 2e-3;

fn pressed() -> DeviceSample {
    at(Vector3::z() * -DEPTH)
}

fn floor(step: u64) -> palpate_haptics::snapshot::HapticSnapshot {
    snapshot_of(step, &[Wall::floor(1e-3)], &Isometry3::identity())
}

#[test]
fn force_fades_in_monotonically_over_the_stated_time() {
    let mut bench = Bench::strong();
    let snapshot = floor(1);
    let records: Vec<_> = (0..400).map(|_| bench.tick(&snapshot, &pressed())).collect();
    let full = records[399].wrench.force.z;
    // The damper's force at first touch decays in the first 30 ticks; from then on the ramp is all there is.
    assert!(records.windows(2).skip(30).all(|pair| pair[1].wrench.force.z >= pair[0].wrench.force.z * (1.0 - 1e-6)));
    assert!(records[0].wrench.force.z < 0.02 * full);
    assert!((records[149].wrench.force.z / full - 0.5).abs() < 0.01);
    assert!(records[298].flags.contains(TickFlags::FADE_IN) && !records[300].flags.contains(TickFlags::FADE_IN));
}

#[test]
fn force_of_a_stale_snapshot_fades_to_zero_and_returns_as_a_ramp() {
    let mut bench = Bench::new(&TickConfig::for_device(&strong_spec()), &strong_spec());
    let mut last = 0.0;
    let mut full = 0.0;
    for i in 0..700 {
        // The first half comes while snapshots are fresh.
        let step = 1 + (i / 33).min(10);
        let record = bench.tick(&floor(step), &pressed());
        let age = record.snapshot_age;
        if i > 340 && age <= 0.2 {
            full = record.wrench.force.z;
        }
        assert_eq!(age > 0.2, record.flags.contains(TickFlags::STALE), "age {age}");
        if age > 0.2 {
            assert!(record.wrench.force.z <= last && last - record.wrench.force.z < 0.01 * full);
        }
        last = record.wrench.force.z;
    }
    for _ in 0..150 {
        last = bench.tick(&floor(11), &pressed()).wrench.force.z;
    }
    assert_eq!(last, 0.0);
    let back = bench.tick(&floor(12), &pressed());
    assert!(back.wrench.force.z < 0.01 * full && back.flags.contains(TickFlags::FADE_IN));
}

#[test]
fn no_snapshot_and_an_invalid_one_give_no_force_and_say_so() {
    let mut bench = Bench::strong();
    let never = palpate_haptics::snapshot::HapticSnapshot::new(8);
    let record = bench.tick(&never, &pressed());
    assert!(record.flags.contains(TickFlags::NO_SNAPSHOT));
    assert_eq!((record.wrench, record.snapshot_age), (Wrench::zero(), f64::INFINITY));

    let before = bench.warm_up(&floor(1), &pressed()).wrench.force.z;
    let mut invalid = floor(2);
    invalid.valid = false;
    let mut last = before;
    for _ in 0..10 {
        let record = bench.tick(&invalid, &pressed());
        assert!(record.flags.contains(TickFlags::INVALID_SNAPSHOT));
        assert!(record.wrench.force.z <= last && last - record.wrench.force.z <= 2.0 + 1e-12, "slew of 2000 N/s");
        last = record.wrench.force.z;
    }
    assert_eq!(last, 0.0);
    assert!(bench.tick(&floor(3), &pressed()).wrench.force.z < 0.02 * before);
}

#[test]
fn the_stricter_of_scene_and_device_limits_the_force_in_its_direction() {
    let spec = DeviceSpec { max_force: 3.0, ..strong_spec() };
    for (scene, expected) in [(None, 3.0), (Some(10.0), 3.0), (Some(0.5), 0.5)] {
        let mut config = patient(&spec);
        config.limits.max_force = scene;
        let mut bench = Bench::new(&config, &spec);
        let wall = Wall { normal: Vector3::new(0.0, 0.6, 0.8), ..Wall::floor(0.0) };
        let snapshot = snapshot_of(1, &[wall], &Isometry3::identity());
        let record = bench.warm_up(&snapshot, &at(wall.normal * -0.02));
        assert!(record.flags.contains(TickFlags::FORCE_LIMITED));
        assert!((record.wrench.force - wall.normal * expected).norm() < 1e-12);
        assert!(record.contact_wrench.force.norm() > 10.0);
    }
}

#[test]
fn slew_is_cut_to_its_rate() {
    let config = LimitsConfig { fade_in: 1e-9, ..LimitsConfig::default() };
    let limits = Limits::new(&config, &strong_spec()).unwrap();
    let mut state = LimitsState::default();
    let target = Wrench { force: Vector3::new(6.0, 8.0, 0.0), torque: Vector3::z() };
    for tick in 1..=30 {
        let mut flags = TickFlags::default();
        let faded = limits.fade(&mut state, &target, 0.0, 1e-3, &mut flags).unwrap();
        let sent = limits.bound(&mut state, &faded, &Twist::default(), 1e-3, &mut flags);
        let share = f64::min(f64::from(tick) * 2.0, 10.0) / 10.0;
        assert!((sent.force - target.force * share).norm() < 1e-12);
        assert!((sent.torque.z - f64::min(f64::from(tick) * 0.04, 1.0)).abs() < 1e-12);
        assert_eq!(flags.contains(TickFlags::SLEW_LIMITED), tick < 25, "tick {tick}");
    }
}

#[test]
fn power_is_cut_to_its_limit_exactly_where_it_is_above_it() {
    let spec = DeviceSpec { max_power: Some(2.0), ..strong_spec() };
    for (scene, allowed) in [(None, 2.0), (Some(5.0), 2.0), (Some(0.5), 0.5)] {
        let config = LimitsConfig { max_power: scene, force_slew: 1e9, torque_slew: 1e9, ..LimitsConfig::default() };
        let limits = Limits::new(&config, &spec).unwrap();
        assert_eq!(limits.max_power(), allowed);
        let mut cuts = 0;
        for k in 0..400 {
            let t = f64::from(k) * 0.1;
            let velocity = Twist { linear: Vector3::new(t.sin(), 0.4 * t.cos(), 0.1), angular: Vector3::z() * t.cos() };
            let target = Wrench { force: Vector3::new(3.0, (0.7 * t).sin(), 0.0), torque: Vector3::z() * 0.3 };
            let mut flags = TickFlags::default();
            let sent = limits.bound(&mut LimitsState::default(), &target, &velocity, PERIOD, &mut flags);
            let power = |w: &Wrench| w.force.dot(&velocity.linear) + w.torque.dot(&velocity.angular);
            let above = power(&target) > allowed;
            assert_eq!(flags.contains(TickFlags::POWER_LIMITED), above, "{} W", power(&target));
            let share = if above { allowed / power(&target) } else { 1.0 };
            assert!((sent.force - target.force * share).norm() < 1e-14 && power(&sent) <= allowed * (1.0 + 1e-12));
            assert!((sent.torque - target.torque * share).norm() < 1e-14);
            cuts += usize::from(above);
        }
        assert!((20..380).contains(&cuts), "{cuts}");
    }
    // No limit where nobody states one, and none for a hand that the force brakes.
    let limits = Limits::new(&LimitsConfig::default(), &DeviceSpec { max_power: None, ..strong_spec() }).unwrap();
    let mut flags = TickFlags::default();
    let fast = Twist { linear: Vector3::x() * 50.0, ..Twist::default() };
    let pushed = Wrench::from_force(Vector3::x());
    assert_eq!(limits.bound(&mut LimitsState::default(), &pushed, &fast, 1.0, &mut flags), pushed);
    assert_eq!(flags, TickFlags::default());
}

#[test]
fn a_tick_is_late_from_half_a_period_on_and_its_time_is_told() {
    let mut bench = Bench::strong();
    let full = bench.warm_up(&floor(1), &pressed()).wrench.force.z;
    for (dt, late, gap) in [
        (0.2e-3, false, false),
        (1e-3, false, false),
        (1.49e-3, false, false),
        (1.51e-3, true, false),
        (0.049, true, false),
        (0.051, true, true),
    ] {
        let time = TickTime { index: 400, time: 0.4, dt, host_lead: None };
        let record = bench.tick.tick(&mut bench.state, &floor(1), &pressed(), time, &mut bench.ws);
        assert_eq!(record.flags.contains(TickFlags::LATE), late, "{dt}");
        assert_eq!(record.flags.contains(TickFlags::GAP), gap, "{dt}");
        assert_eq!(record.dt, dt);
        assert_eq!(record.wrench.force.z < 0.5 * full, gap, "the force fades where it is later than the gap: {dt}");
    }
}

#[test]
fn a_bad_pose_ends_the_force_at_once_and_its_return_is_a_ramp() {
    let nan = Isometry3::translation(0.0, f64::NAN, 0.0);
    let far = Isometry3::translation(0.0, 0.0, -1e9);
    let squashed = Isometry3::from_parts(
        Translation3::identity(),
        UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 0.0, 0.0)),
    );
    for pose in [nan, far, squashed] {
        let mut bench = Bench::strong();
        let full = bench.warm_up(&floor(1), &pressed()).wrench.force.z;
        let bad = bench.tick(&floor(1), &DeviceSample::at_rest(0.0, pose));
        assert!(bad.flags.contains(TickFlags::BAD_POSE));
        assert_eq!((bad.wrench, bad.device_pose), (Wrench::zero(), pressed().pose));
        let after = bench.tick(&floor(1), &pressed());
        assert!(after.wrench.force.z < 0.02 * full && after.flags.contains(TickFlags::FADE_IN));
    }
}

#[test]
fn a_velocity_or_a_gripper_that_is_no_number_ends_the_force_at_once_and_its_return_is_a_ramp() {
    let told = |linear: f64, angular: f64| Twist { linear: Vector3::x() * linear, angular: Vector3::y() * angular };
    let bad = [
        DeviceSample { velocity: told(f64::NAN, 0.0), ..pressed() },
        DeviceSample { velocity: told(0.0, f64::NEG_INFINITY), ..pressed() },
        DeviceSample { velocity: told(1e300, 0.0), ..pressed() },
        DeviceSample { gripper: f64::NAN, ..pressed() },
    ];
    for sample in bad {
        let mut bench = Bench::strong();
        let full = bench.warm_up(&floor(1), &pressed()).wrench.force.z;
        let record = bench.tick(&floor(1), &sample);
        assert!(record.flags.contains(TickFlags::BAD_POSE), "{sample:?}");
        assert_eq!((record.wrench, record.device_velocity), (Wrench::zero(), Twist::default()));
        let after = bench.tick(&floor(1), &pressed());
        assert!(after.wrench.force.z < 0.02 * full && after.flags.contains(TickFlags::FADE_IN));
    }
    // And by itself the limit of power lets nothing through that it cannot tell.
    let limits =
        Limits::new(&LimitsConfig { max_power: Some(1e-3), ..LimitsConfig::default() }, &strong_spec()).unwrap();
    for speed in [f64::NAN, f64::INFINITY, f64::MAX] {
        let (mut flags, push) = (TickFlags::default(), Wrench::from_force(Vector3::x() * 2.0));
        let sent = limits.bound(&mut LimitsState::default(), &push, &told(speed, 0.0), 1.0, &mut flags);
        assert!(sent.force.norm() < 1e-300 && flags.contains(TickFlags::POWER_LIMITED), "{speed}: {sent:?}");
    }
}

#[test]
fn numbers_in_the_snapshot_that_are_not_finite_end_the_force() {
    for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut in_compliance = floor(2);
        in_compliance.compliance_mut().fill(poison);
        let in_gap = snapshot_of(2, &[Wall { offset: poison, ..Wall::floor(1e-3) }], &Isometry3::identity());
        for bad in [in_compliance, in_gap] {
            let mut bench = Bench::strong();
            let full = bench.warm_up(&floor(1), &pressed()).wrench.force.z;
            let record = bench.tick(&bad, &pressed());
            assert_eq!(record.wrench, Wrench::zero());
            assert!(record.flags.contains(TickFlags::NON_FINITE), "{:?}", record.flags.names().collect::<Vec<_>>());
            let well = bench.warm_up(&floor(3), &pressed()).wrench.force.z;
            assert!((well / full - 1.0).abs() < 1e-5, "it recovers");
        }
    }
}

#[test]
fn a_gap_between_ticks_makes_the_force_return_as_a_ramp() {
    for dt in [0.5, -1e-3, 0.0, f64::NAN, f64::INFINITY] {
        let mut bench = Bench::strong();
        let full = bench.warm_up(&floor(1), &pressed()).wrench.force.z;
        let time = TickTime { index: 400, time: 0.4, dt, host_lead: None };
        let record = bench.tick.tick(&mut bench.state, &floor(2), &pressed(), time, &mut bench.ws);
        assert!(record.flags.contains(TickFlags::GAP));
        // One period's share of 0.3 s, whatever the clock said.
        assert!((record.gain - PERIOD / 0.3).abs() < 1e-12, "{}", record.gain);
        assert!(record.wrench.force.z <= 0.02 * full, "{}", record.wrench.force.z);
    }
}

/// A device that fails to read in some ticks and to write in others, and whose motors are saturated from tick 700 on.
struct Faulty {
    inner: ScriptedDevice,
    tick: u64,
}

impl HapticDevice for Faulty {
    fn spec(&self) -> &DeviceSpec {
        self.inner.spec()
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        self.tick = tick.index;
        if tick.index == 500 { Err(DeviceError::Disconnected) } else { self.inner.read(tick) }
    }

    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if self.tick == 1000 { Err(DeviceError::Driver(-3)) } else { self.inner.write(wrench) }
    }

    fn limited(&self) -> TickFlags {
        if self.tick < 700 { TickFlags::default() } else { TickFlags::FORCE_LIMITED }
    }

    fn close(&mut self) {
        self.inner.close();
    }
}

#[test]
fn a_device_that_does_not_answer_gets_no_force_and_then_a_ramp() {
    let inner = ScriptedDevice::new(HandScript::at(Vector3::z() * -DEPTH));
    let mut device = Faulty { inner, tick: 0 };
    let mut bench = Bench::strong();
    let (mut writer, mut reader) = latest(&floor(1));
    let mut full = 0.0;
    for index in 0..1500 {
        writer.value_mut().copy_from(&floor(1 + index / 33));
        writer.publish();
        let time = TickTime::regular(index, PERIOD);
        let record = run_tick(&bench.tick, &mut bench.state, &mut bench.ws, &mut reader, &mut device, time);
        let force = record.wrench.force.z;
        match index {
            499 | 999 => full = force,
            500 | 1000 => {
                assert!(record.flags.contains(TickFlags::DEVICE_ERROR));
                assert_eq!(record.wrench, Wrench::zero());
                assert!(record.device_error.is_some());
            }
            501 | 1001 => assert!(force > 0.0 && force < 0.05 * full && record.device_error.is_none()),
            _ => {}
        }
        if ![500, 1000].contains(&index) {
            assert_eq!(device.inner.wrench(), record.wrench);
        }
        // The device's own limits are told, but not of a force that it did not take.
        let limited = index >= 700 && index != 1000;
        assert_eq!(record.flags.contains(TickFlags::FORCE_LIMITED), limited, "tick {index}");
    }
}

#[test]
fn documented_defaults_are_the_defaults() {
    let expected = LimitsConfig {
        max_force: None,
        max_torque: None,
        max_power: None,
        force_slew: 2000.0,
        torque_slew: 40.0,
        fade_in: 0.3,
        stale_after: 0.2,
        stale_zero: 0.5,
        gap: 0.05,
        jump_speed: 5.0,
        jump_distance: 0.02,
    };
    assert_eq!(serde_json::from_str::<LimitsConfig>("{}").unwrap(), expected);
    let touch = TickConfig::for_device(&DeviceSpec::preset("touch").unwrap());
    assert_eq!((touch.coupling.translation.stiffness, touch.coupling.translation.damping), (200.0, 2.0));
    let omega = TickConfig::for_device(&DeviceSpec::preset("omega.6").unwrap());
    assert_eq!(omega.coupling.translation.stiffness, 1000.0);
    assert_eq!((omega.period, omega.sweeps, omega.tolerance), (1e-3, 30, 1e-6));
}
