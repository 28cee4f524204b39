//! A hand whose grasp gives way, against closed forms.

use nalgebra::Vector3;
use palpate_haptics::device::{HapticDevice, TickTime, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::hand::Hand;
use palpate_haptics::script::HandScript;
use palpate_haptics::wrench::Wrench;

const PERIOD: f64 = 1e-3;

fn still() -> HandScript {
    HandScript::at(Vector3::zeros())
}

#[test]
fn a_grasp_that_gives_way_keeps_momentum_and_energy_and_stretches_as_two_springs_do() {
    // Two masses on a spring without damping: the centre of mass keeps its speed, and the energy stays.
    let hand = Hand::rigid(0.3, 0.0, 0.0).grasping(500.0, 0.0);
    let config = VirtualDeviceConfig { damping: 0.0, ..VirtualDeviceConfig::ideal(0) };
    let mut device = VirtualDevice::new(config, hand, still()).unwrap().with_velocity(Vector3::x() * 0.2);
    // The hand begins with the device's speed: a push on the device alone sets both swinging about one another.
    device.hold(Wrench::from_force(Vector3::x() * 2.0));
    device.read(TickTime::regular(0, PERIOD)).unwrap();
    device.read(TickTime::regular(1, PERIOD)).unwrap();
    device.hold(Wrench::zero());
    let begin = device.energy(0.0);
    let (mut path, mut least, mut most) = (device.position().x, f64::INFINITY, f64::NEG_INFINITY);
    for index in 2..10_002 {
        device.read(TickTime::regular(index, PERIOD)).unwrap();
        assert!((device.energy(0.0) / begin - 1.0).abs() < 1e-10, "{} J", device.energy(0.0));
        let speed = device.velocity().x;
        (least, most) = (least.min(speed), most.max(speed));
    }
    // 2 N for a millisecond on 0.4 kg at 0.2 m/s; ten seconds of whole and part swings of 12.9 Hz.
    let centre = 0.2 + 2.0 * 1e-3 / 0.4;
    path = (device.position().x - path) / 10.0;
    assert!((path - centre).abs() < 1e-4, "{path} m/s, not {centre}");
    // On the device 2 N for a millisecond are 0.02 m/s, of which 3/4 are motion against the hand.
    assert!((most - least - 2.0 * 0.015).abs() < 3e-4, "{least} to {most} m/s");

    // At rest under a force, the springs of grasp and hand yield one after the other.
    let hand = Hand::preset("normal").unwrap();
    let mut device = VirtualDevice::new(VirtualDeviceConfig::ideal(0), hand, still()).unwrap();
    for index in 0..20_000 {
        device.read(TickTime::regular(index, PERIOD)).unwrap();
        device.write(Wrench::from_force(Vector3::y() * 0.7)).unwrap();
    }
    let expected = 0.7 / hand.slow_stiffness();
    assert!((device.position().y - expected).abs() < 1e-9, "{} m, not {expected}", device.position().y);
    let series = 1.0 / (1.0 / 379.5 + 1.0 / 78.75);
    assert!((hand.slow_stiffness() - series).abs() < 1e-9);
}

#[test]
fn a_grasp_that_lets_go_leaves_the_bare_device_and_takes_it_again_without_a_blow() {
    let script = still().hold(0.2).unwrap().let_go(0.5).unwrap().hold(2.0).unwrap();
    let hand = Hand::preset("firm").unwrap();
    let mut device = VirtualDevice::new(VirtualDeviceConfig::ideal(0), hand, script).unwrap();
    let (mut fastest, mut before) = (0.0_f64, Vector3::zeros());
    for index in 0..2700 {
        device.read(TickTime::regular(index, PERIOD)).unwrap();
        let free = (200..700).contains(&index);
        device.write(Wrench::from_force(Vector3::x() * if free { 0.05 } else { 0.0 })).unwrap();
        if index > 700 {
            // What the grasp's damper and spring do in a millisecond: far below the change of a rigid blow.
            fastest = fastest.max((device.velocity() - before).norm());
        } else if index == 690 {
            // F/b (1 − e^(−b t/m)) after 0.489 s of 0.05 N.
            let expected = 0.05 / 0.2 * (1.0 - (-0.2 / 0.1 * 0.489_f64).exp());
            assert!((device.velocity().x - expected).abs() < 2e-3, "{} m/s, not {expected}", device.velocity().x);
        }
        before = device.velocity();
    }
    assert!(fastest < 0.02, "{fastest} m/s in a tick");
    assert!(device.position().norm() < 0.03, "{}", device.position());
}
