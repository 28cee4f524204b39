//! Any bits at all in every number that comes in: the force stays finite and within limits.

use crate::rig::{Bench, PERIOD, Wall, snapshot_of, strong_spec};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use palpate_collision::tool::Hinge;
use palpate_haptics::device::{DeviceSample, DeviceSpec, TickTime};
use palpate_haptics::gripper::GripConfig;
use palpate_haptics::record::TickFlags;
use palpate_haptics::tick::TickConfig;
use palpate_haptics::wrench::{Twist, Wrench};
use proptest::prelude::*;

/// What a device tells.
#[derive(Clone, Debug)]
struct Told {
    position: [f64; 3],
    rotation: [f64; 4],
    velocity: [[f64; 3]; 2],
    gripper: f64,
}

/// What a step tells.
#[derive(Clone, Debug)]
struct Shown {
    offset: f64,
    lever: f64,
    compliance: f64,
    valid: bool,
    contacts: u8,
}

/// A number that is most often plain, so that contacts, and their poisoning, do happen.
fn number(plain: std::ops::Range<f64>) -> BoxedStrategy<f64> {
    prop_oneof![12 => plain, 1 => prop::num::f64::ANY, 1 => Just(f64::NAN), 1 => Just(1e300)].boxed()
}

fn told() -> impl Strategy<Value = Told> {
    let (place, speed) = (|| number(-0.01..0.01), || number(-0.5..0.5));
    let rotation = prop_oneof![6 => Just([1.0, 0.0, 0.0, 0.0]), 1 => prop::array::uniform4(prop::num::f64::ANY)];
    // Most often at rest: six numbers are seldom all plain.
    let velocity =
        prop_oneof![1 => Just([[0.0; 3]; 2]), 1 => [[speed(), speed(), speed()], [speed(), speed(), speed()]]];
    ([place(), place(), place()], rotation, velocity, number(0.0..1.0))
        .prop_map(|(position, rotation, velocity, gripper)| Told { position, rotation, velocity, gripper })
}

fn shown() -> impl Strategy<Value = Shown> {
    let number = || number(-0.01..0.01);
    (number(), number(), number().prop_map(f64::abs), prop::bool::weighted(0.9), 0..4_u8)
        .prop_map(|(offset, lever, compliance, valid, contacts)| Shown { offset, lever, compliance, valid, contacts })
}

fn is_finite(t: &Told) -> bool {
    let all = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    all(&t.position) && all(&t.rotation) && all(t.velocity.as_flattened()) && t.gripper.is_finite()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn force_is_finite_and_within_limits_whatever_comes_in(
        ticks in prop::collection::vec((told(), shown(), prop_oneof![3 => Just(PERIOD), 1 => prop::num::f64::ANY]), 1..60),
    ) {
        let spec = DeviceSpec { max_force: 3.0, max_torque: 0.1, ..strong_spec() };
        let mut config = TickConfig::for_device(&spec);
        (config.limits.fade_in, config.limits.force_slew, config.limits.max_power) = (5e-3, 1e9, Some(0.05));
        config.limits.torque_slew = 1e9;
        let mut bench = Bench::new(&config, &spec);
        let (grip, hinge) = (GripConfig::default(), Hinge {
            pivot: Vector3::zeros(), axis: Vector3::x_axis(), closed: 0.0, open: 0.6,
        });
        bench.tick = bench.tick.with_gripper(&grip, hinge).unwrap();
        for (i, (told, shown, dt)) in ticks.into_iter().enumerate() {
            let normals = [Vector3::z(), Vector3::x(), Vector3::new(0.6, 0.0, 0.8), -Vector3::y()];
            let (offset, w) = (shown.offset, shown.compliance);
            let walls: Vec<_> = normals[..shown.contacts as usize]
                .iter()
                .map(|n| Wall { normal: *n, offset, w, friction: Some(0.5) })
                .collect();
            let tool = Isometry3::translation(shown.lever, 0.0, 0.0);
            let mut snapshot = snapshot_of(1 + i as u64 / 5, &walls, &tool);
            snapshot.valid = shown.valid;
            let [w, x, y, z] = told.rotation;
            let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
            let pose = Isometry3::from_parts(Translation3::from(told.position), rotation);
            let [linear, angular] = told.velocity.map(Vector3::from);
            let velocity = Twist { linear, angular };
            let sample = DeviceSample { velocity, gripper: told.gripper, ..DeviceSample::at_rest(dt, pose) };
            let time = TickTime { index: i as u64, time: i as f64 * PERIOD, dt, host_lead: None };
            let record = bench.tick.tick(&mut bench.state, &snapshot, &sample, time, &mut bench.ws);
            prop_assert!(record.wrench.is_finite());
            prop_assert!(record.contact_wrench.is_finite());
            prop_assert!(record.wrench.force.norm() <= 3.0 * (1.0 + 1e-15), "{}", record.wrench.force.norm());
            prop_assert!(record.wrench.torque.norm() <= 0.1 * (1.0 + 1e-15));
            prop_assert!((0.0..=1.0).contains(&record.gain));
            let grip = record.gripper;
            prop_assert!(grip.torque.abs() <= 0.3 && grip.effort.is_finite() && grip.opening.is_finite(), "{grip:?}");
            prop_assert!(grip.energy.is_finite() && grip.account.is_finite() && record.energy.account.is_finite());
            if !is_finite(&told) {
                prop_assert!(record.flags.contains(TickFlags::BAD_POSE));
                prop_assert_eq!(record.wrench, Wrench::zero());
            }
            // The slew that is granted here brings any power down within a tick of any length; not within none.
            let power = record.wrench.force.dot(&linear) + record.wrench.torque.dot(&angular);
            let within = record.wrench == Wrench::zero() || power <= 0.05 * (1.0 + 1e-9);
            prop_assert!(within || dt != PERIOD, "{power} W");
        }
    }
}
