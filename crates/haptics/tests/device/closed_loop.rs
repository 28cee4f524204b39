//! Device, hand, coupling and wall in a closed loop: stable for every hand, on stiff and on soft ground.
#![allow(clippy::print_stdout)] // what was measured, for `--nocapture`

use crate::rig::{Loop, PERIOD, Wall};
use nalgebra::Vector3;
use palpate_haptics::coupling::{CouplingConfig, stiffness_for_any_wall};
use palpate_haptics::device::{DeviceSpec, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::hand::{HAND_PRESETS, Hand};
use palpate_haptics::record::TickRecord;
use palpate_haptics::script::HandScript;
use palpate_haptics::tick::TickConfig;

/// What a run of five seconds came to.
#[derive(Debug)]
struct Outcome {
    /// Largest speed in the last half second \[m/s\].
    end_speed: f64,
    /// Largest force \[N\].
    peak_force: f64,
    /// Force at the end \[N\].
    end_force: f64,
    /// Largest energy of the device and its hand after the script has ended \[J\], in each second.
    energy: [f64; 5],
}

fn run(device: VirtualDevice, walls: Vec<Wall>) -> (Outcome, Vec<TickRecord>) {
    let mut rig = Loop::new(device, walls);
    let mut outcome = Outcome { end_speed: 0.0, peak_force: 0.0, end_force: 0.0, energy: [0.0; 5] };
    let mut records = Vec::with_capacity(5000);
    for index in 0..5000_usize {
        let record = rig.tick();
        let speed = rig.device.velocity().norm();
        outcome.peak_force = outcome.peak_force.max(record.wrench.force.norm());
        outcome.end_force = record.wrench.force.norm();
        if index >= 4500 {
            outcome.end_speed = outcome.end_speed.max(speed);
        }
        let energy = &mut outcome.energy[index / 1000];
        *energy = energy.max(rig.device.energy(record.time));
        records.push(record);
    }
    (outcome, records)
}

/// 10 mm above the floor to 5 mm below it in half a second, and held there.
fn press() -> HandScript {
    HandScript::at(Vector3::z() * 0.01).move_to(Vector3::z() * -0.005, 0.5).unwrap()
}

#[test]
fn every_hand_presses_stiff_and_soft_walls_and_comes_to_rest() {
    for preset in HAND_PRESETS.iter().filter(|preset| preset.name != "none") {
        for wall in [0.0, 1.0 / 5000.0, 1.0 / 1000.0, 1.0 / 200.0] {
            for config in [VirtualDeviceConfig::default(), VirtualDeviceConfig::ideal(1)] {
                let device = VirtualDevice::new(config, preset.hand, press()).unwrap();
                let coupling = CouplingConfig::for_device(&DeviceSpec::virtual_device(0.0)).translation;
                let (outcome, _) = run(device, vec![Wall::floor(wall).with_friction(0.3)]);
                println!("{:10} W {wall:.1e} friction {:.2} {outcome:?}", preset.name, config.friction);
                // Springs in series: hand, coupling, wall; friction of the device may keep 0.06 N of it.
                let series = 1.0 / (1.0 / preset.hand.slow_stiffness() + 1.0 / coupling.stiffness + wall);
                let expected = 0.005 * series;
                assert!((outcome.end_force - expected).abs() < 0.02 * expected + config.friction, "{expected} N");
                // The encoder's noise is one step a tick into B/T: 0.06 N on 0.1 kg for 1 ms is 0.6 mm/s.
                let quiet = if config.encoder_step > 0.0 { 2e-3 } else { 1e-6 };
                assert!(outcome.end_speed < quiet, "{} on W = {wall}: {outcome:?}", preset.name);
                assert!(outcome.energy[4] <= outcome.energy[2] * (1.0 + 1e-3), "energy grows: {outcome:?}");
            }
        }
    }
}

#[test]
fn a_device_that_nobody_holds_loses_energy_between_two_walls() {
    // Thrown at 0.1 m/s into a slot of 2 mm; it bounces some fifty times a second. Ideal: only b and the coupling.
    for wall in [0.0, 1.0 / 5000.0, 1.0 / 700.0, 1.0 / 200.0] {
        for config in [VirtualDeviceConfig::default(), VirtualDeviceConfig::ideal(1)] {
            let hand = Hand::preset("none").unwrap();
            let device = VirtualDevice::new(config, hand, HandScript::at(Vector3::zeros())).unwrap();
            let device = device.with_velocity(Vector3::z() * 0.1);
            let floor = Wall { offset: -1e-3, ..Wall::floor(wall) };
            let ceiling = Wall { normal: -Vector3::z(), ..floor };
            let (outcome, _) = run(device, vec![floor, ceiling]);
            println!("none W {wall:.1e} friction {:.2} {outcome:?}", config.friction);
            assert!(outcome.energy.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-9)), "{outcome:?}");
            assert!(outcome.energy[4] < 0.1 * outcome.energy[0], "{outcome:?}");
        }
    }
}

#[test]
fn the_rule_for_any_wall_separates_couplings_that_hold_from_ones_that_do_not() {
    // In a slot without width the loop is linear. Ideal device, nobody holding, one tick of delay. Walls as soft as
    // the coupling are the worst, not rigid ones.
    let rule = stiffness_for_any_wall(0.2, 2.0, PERIOD, 1);
    assert!((rule - 843.3).abs() < 0.1);
    let grows = |stiffness: f64, wall: f64| {
        let hand = Hand::preset("none").unwrap();
        let device = VirtualDevice::new(VirtualDeviceConfig::ideal(1), hand, HandScript::at(Vector3::zeros())).unwrap();
        let spec = DeviceSpec { max_force: 1e3, max_power: None, ..DeviceSpec::virtual_device(0.0) };
        let mut config = TickConfig::for_device(&spec);
        config.coupling.translation.stiffness = stiffness;
        // The linear loop and nothing else.
        config.passivity.control = false;
        let device = device.with_velocity(Vector3::z() * 0.02).with_spec(spec);
        let walls = vec![Wall::floor(1.0 / wall), Wall { normal: -Vector3::z(), ..Wall::floor(1.0 / wall) }];
        let mut rig = Loop::with_config(device, walls, &config);
        let mut peaks = [0.0_f64; 5];
        for index in 0..5000 {
            rig.tick();
            let speed = rig.device.velocity().norm();
            peaks[index / 1000] = peaks[index / 1000].max(speed);
        }
        peaks[4] > peaks[1]
    };
    let walls = [100.0, 200.0, 400.0, 800.0, 1600.0, 1e5];
    // First order in T: a tenth to either side is clear of the second.
    assert!(walls.iter().all(|wall| !grows(0.9 * rule, *wall)));
    assert!(walls.iter().any(|wall| grows(1.15 * rule, *wall)));
}

#[test]
fn a_hand_that_lets_go_of_a_pressed_device_leaves_it_to_come_to_rest() {
    let script = press().hold(0.5).unwrap().let_go(5.0).unwrap();
    let hand = Hand::preset("fingertip").unwrap();
    let device = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script).unwrap();
    let (outcome, records) = run(device, vec![Wall::floor(1.0 / 1000.0)]);
    assert!(outcome.end_speed < 1e-3 && outcome.end_force < 0.1, "{outcome:?}");
    let last = records.last().unwrap();
    assert!(last.device_pose.translation.z.abs() < 0.1);
}

#[test]
fn a_virtual_run_is_the_same_to_the_bit() {
    let once = || {
        let script = press().hold(0.2).unwrap().move_to(Vector3::new(0.02, 0.01, -0.005), 0.5).unwrap();
        let hand = Hand::preset("stylus").unwrap();
        let device = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script).unwrap();
        let walls = vec![
            Wall::floor(1e-3).with_friction(0.4),
            Wall { normal: -Vector3::x(), offset: -0.01, ..Wall::floor(1e-3) },
        ];
        run(device, walls).1
    };
    let (a, b) = (once(), once());
    assert!(a.iter().any(|record| record.active == 2));
    // All numbers of a record, in text that tells every two floats apart.
    assert!(a.iter().zip(&b).all(|(a, b)| format!("{a:?}") == format!("{b:?}")));
}
