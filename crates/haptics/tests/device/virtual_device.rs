//! The virtual device and hand against closed forms.

use nalgebra::Vector3;
use palpate_haptics::SetupError;
use palpate_haptics::device::{
    self, DeviceError, DeviceSetup, HapticDevice, TickTime, VirtualDevice, VirtualDeviceConfig,
};
use palpate_haptics::hand::{HAND_PRESETS, Hand};
use palpate_haptics::script::HandScript;
use palpate_haptics::wrench::Wrench;

const PERIOD: f64 = 1e-3;

fn still() -> HandScript {
    HandScript::at(Vector3::zeros())
}

fn none() -> Hand {
    Hand::preset("none").unwrap()
}

#[test]
fn free_response_is_that_of_a_mass_on_spring_and_damper() {
    let over_damped = Hand::rigid(0.05, 4.0, 5.0);
    let rigid = HAND_PRESETS.iter().map(|preset| preset.hand).filter(|hand| hand.grasp.is_none());
    for hand in rigid.chain([over_damped]) {
        let v0 = 0.3;
        let config = VirtualDeviceConfig::ideal(1);
        let mut device = VirtualDevice::new(config, hand, still()).unwrap().with_velocity(Vector3::y() * v0);
        let (m, b, k) = (0.1 + hand.mass, 0.2 + hand.damping, hand.stiffness);
        let (a, d) = (0.5 * b / m, 0.25 * b * b / (m * m) - k / m);
        let w = d.abs().sqrt();
        for index in 0..2000 {
            let tick = TickTime::regular(index, PERIOD);
            device.read(tick).unwrap();
            let t = tick.time;
            let expected = v0 / w * (-a * t).exp() * if d < 0.0 { (w * t).sin() } else { (w * t).sinh() };
            // 20,000 exact sub-steps: rounding of 1e-11 relative in the propagator's differences, once each.
            let error = (device.position() - Vector3::y() * expected).norm();
            assert!(error < 1e-10, "{hand:?} at {t} s: {error}");
        }
    }
}

#[test]
fn coulomb_friction_stops_the_device_where_the_closed_form_says() {
    // m v' = −b v − f  =>  stop at t = (m/b) ln(1 + b v0/f), x = (m/b) (v0 − (f/b) ln(1 + b v0/f)).
    let config = VirtualDeviceConfig { encoder_step: 0.0, ..VirtualDeviceConfig::default() };
    let (m, b, f, v0) = (config.mass, config.damping, config.friction, 0.1_f64);
    let direction = Vector3::new(2.0, -1.0, 2.0) / 3.0;
    let mut device = VirtualDevice::new(config, none(), still()).unwrap().with_velocity(direction * v0);
    let stop = m / b * (1.0 + b * v0 / f).ln();
    let distance = m / b * (v0 - f / b * (1.0 + b * v0 / f).ln());
    let mut at_rest = None;
    for index in 0..1000 {
        device.read(TickTime::regular(index, PERIOD)).unwrap();
        if at_rest.is_none() && device.velocity().norm() < 1e-15 {
            at_rest = Some(index as f64 * PERIOD);
        }
    }
    let at_rest = at_rest.expect("friction stops it");
    assert!((at_rest - stop).abs() <= PERIOD, "{at_rest} s, not {stop} s");
    // Friction is smaller than f in the sub-step of the stop only: less than f h²/m = 6e-9 m.
    assert!((device.position() - direction * distance).norm() < 1e-8);
}

#[test]
fn friction_holds_a_load_below_it_without_creep_and_yields_above_it() {
    for (load, moves) in [(0.059, false), (0.061, true)] {
        let mut device = VirtualDevice::new(VirtualDeviceConfig::default(), none(), still()).unwrap();
        for index in 0..5000 {
            device.read(TickTime::regular(index, PERIOD)).unwrap();
            device.write(Wrench::from_force(Vector3::x() * load)).unwrap();
        }
        assert_eq!(device.position().norm() > 0.0, moves, "load {load} N");
    }
}

#[test]
fn a_force_acts_after_the_delay_and_not_before() {
    for delay in [0, 1, 4] {
        let mut device = VirtualDevice::new(VirtualDeviceConfig::ideal(delay), none(), still()).unwrap();
        let mut first_motion = None;
        for index in 0..10 {
            device.read(TickTime::regular(index, PERIOD)).unwrap();
            device.write(Wrench::from_force(Vector3::x())).unwrap();
            if first_motion.is_none() && device.position().x > 0.0 {
                first_motion = Some(index);
            }
        }
        assert_eq!(first_motion, Some(delay as u64 + 1));
    }
}

#[test]
fn measured_position_is_a_whole_number_of_encoder_steps_next_to_the_truth() {
    let hand = Hand::preset("fingertip").unwrap();
    let script = still().move_to(Vector3::new(0.01, -0.02, 0.005), 0.5).unwrap();
    let mut device = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script).unwrap();
    for index in 0..700 {
        let sample = device.read(TickTime::regular(index, PERIOD)).unwrap();
        for (measured, truth) in sample.pose.translation.vector.iter().zip(device.position().iter()) {
            let steps = measured / 30e-6;
            assert!((steps - steps.round()).abs() < 1e-9);
            assert!((measured - truth).abs() <= 15e-6 * (1.0 + 1e-9));
        }
    }
}

#[test]
fn a_hand_that_lets_go_takes_its_mass_and_spring_with_it() {
    let config = VirtualDeviceConfig::ideal(0);
    let script = still().move_to(Vector3::x() * 0.02, 0.2).unwrap().hold(0.3).unwrap().let_go(1.0).unwrap();
    let script = script.hold(0.5).unwrap();
    let hand = Hand { mass: 0.2, ..Hand::preset("fingertip").unwrap() };
    let mut device = VirtualDevice::new(config, hand, script).unwrap();
    // Free under F, with the device's own m and b: x = x0 + v0 (m/b) g + (F/b) (t − (m/b) g), g = 1 − e^(−b t/m).
    let (m, b, force) = (0.1_f64, 0.2_f64, 0.1_f64);
    let mut release = None;
    for index in 0..2000 {
        device.read(TickTime::regular(index, PERIOD)).unwrap();
        let free = (500..1500).contains(&index);
        device.write(Wrench::from_force(Vector3::x() * if free { force } else { 0.0 })).unwrap();
        if free {
            let now = (index as f64 * PERIOD, device.position().x, device.velocity().x);
            let (t0, x0, v0) = *release.get_or_insert(now);
            let t = now.0 - t0;
            let g = 1.0 - (-b * t / m).exp();
            let expected = x0 + v0 * m / b * g + force / b * (t - m / b * g);
            assert!((now.1 - expected).abs() < 1e-10, "{t} s after: {} != {expected}", now.1);
        }
    }
    // Taken again, it is brought back towards 0.02 m: e^(−3.7 · 0.5) of some 0.27 m is left.
    assert!((device.position().x - 0.02).abs() < 0.06, "{}", device.position());
}

#[test]
fn a_run_is_the_same_to_the_bit() {
    let run = || {
        let script = still().stroke(Vector3::new(0.01, 0.0, -0.01), 0.4, 3).unwrap();
        let hand = Hand::preset("stylus").unwrap();
        let mut device = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script).unwrap();
        (0..1500)
            .map(|index| {
                let sample = device.read(TickTime::regular(index, PERIOD)).unwrap();
                let x = sample.pose.translation.vector;
                device.write(Wrench::from_force(-x * 300.0)).unwrap();
                [device.position(), device.velocity(), sample.velocity.linear].map(|v| v.map(f64::to_bits))
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn a_jitter_samples_late_by_a_share_of_it_and_is_a_function_of_seed_and_tick() {
    let run = |jitter: f64, seed: u64| {
        let config = VirtualDeviceConfig { jitter, seed, ..VirtualDeviceConfig::ideal(0) };
        let mut device = VirtualDevice::new(config, none(), still()).unwrap().with_velocity(Vector3::x() * 0.1);
        (0..2000)
            .map(|index| {
                let tick = TickTime::regular(index, PERIOD);
                let sample = device.read(tick).unwrap();
                (sample.time - tick.time, device.position().x, sample.time)
            })
            .collect::<Vec<_>>()
    };
    let late = run(0.4e-3, 7);
    // Free motion to the device's own time: x = v0 m/b (1 − e^(−b t/m)), whatever the sequence of times.
    for (delay, x, time) in &late[1..] {
        assert!((0.0..0.4e-3).contains(delay), "{delay} s late");
        let expected = 0.1 * 0.5 * (1.0 - (-2.0 * time).exp());
        assert!((x - expected).abs() < 1e-12, "{time} s: {x} != {expected}");
    }
    // Uniform on [0, 0.4) ms: mean 0.2 ms with a deviation of 0.4/sqrt(12 · 2000) ms.
    let mean = late.iter().map(|(delay, ..)| delay).sum::<f64>() / 2000.0;
    assert!((mean - 0.2e-3).abs() < 4.0 * 0.4e-3 / (12.0_f64 * 2000.0).sqrt(), "{mean} s");
    assert_eq!(late, run(0.4e-3, 7));
    assert_ne!(late, run(0.4e-3, 8));
    assert!(run(0.0, 7).iter().all(|(delay, ..)| *delay == 0.0));
}

#[test]
fn devices_open_by_uri_and_unknown_names_list_the_known() {
    let setup = DeviceSetup { script: still(), hand: Hand::default(), mechanics: VirtualDeviceConfig::default() };
    for uri in ["virtual", "virtual:arm", "virtual:none", "scripted"] {
        let mut device = device::open(uri, &setup).unwrap_or_else(|error| panic!("{uri}: {error}"));
        device.spec().validate().unwrap();
        device.read(TickTime::regular(0, PERIOD)).unwrap();
        device.write(Wrench::zero()).unwrap();
        device.close();
        assert_eq!(device.read(TickTime::regular(1, PERIOD)).unwrap_err(), DeviceError::Closed);
        assert_eq!(device.write(Wrench::zero()).unwrap_err(), DeviceError::Closed);
    }
    let unknown = |uri| device::open(uri, &setup).err().map(|error| error.to_string()).unwrap_or_default();
    assert_eq!(unknown("omega"), "unknown device `omega`: known are virtual, scripted");
    assert!(unknown("virtual:fist").contains("none, loose, normal, firm, fingertip, stylus, arm"));
}

#[test]
fn numbers_out_of_range_are_refused_by_name() {
    let good = VirtualDeviceConfig::default();
    let bad = [
        (VirtualDeviceConfig { mass: 0.0, ..good }, "mass"),
        (VirtualDeviceConfig { damping: -1.0, ..good }, "damping"),
        (VirtualDeviceConfig { friction: f64::NAN, ..good }, "friction"),
        (VirtualDeviceConfig { delay_ticks: 16, ..good }, "delay_ticks"),
        (VirtualDeviceConfig { substeps: 0, ..good }, "substeps"),
        (VirtualDeviceConfig { velocity_cutoff: 0.0, ..good }, "velocity_cutoff"),
        (VirtualDeviceConfig { jitter: -1e-4, ..good }, "jitter"),
    ];
    for (config, name) in bad {
        let error = VirtualDevice::new(config, none(), still()).unwrap_err();
        assert!(matches!(error, SetupError::OutOfRange { what, .. } if what.contains(name)), "{error}");
    }
    assert!(Hand { stiffness: -1.0, ..none() }.validate().is_err());
    assert!(none().grasping(100.0, 1.0).validate().is_err(), "two springs without a mass between them");
    assert!(Hand::rigid(0.1, 0.0, 0.0).grasping(0.0, 1.0).validate().is_err());
}

#[test]
fn documented_defaults_are_the_defaults() {
    let config: VirtualDeviceConfig = serde_json::from_str("{}").unwrap();
    let expected = VirtualDeviceConfig {
        mass: 0.1,
        damping: 0.2,
        friction: 0.06,
        encoder_step: 30e-6,
        delay_ticks: 1,
        velocity_cutoff: 100.0,
        substeps: 10,
        jitter: 0.0,
        seed: 0,
    };
    assert_eq!(config, expected);
    assert_eq!(Hand::default(), Hand::preset("fingertip").unwrap());
    for preset in device::DEVICE_PRESETS {
        device::DeviceSpec::preset(preset.name).unwrap().validate().unwrap();
    }
}
