//! The passivity layer by itself: when it acts, how much it takes, and what it leaves whatever the numbers are.

use crate::rig::{PERIOD, strong_spec};
use nalgebra::{Isometry3, Vector3};
use palpate_haptics::device::DeviceSpec;
use palpate_haptics::passivity::{Passivity, PassivityConfig, PassivityState};
use palpate_haptics::record::TickFlags;
use palpate_haptics::wrench::{Twist, Wrench};
use proptest::prelude::*;

fn layer(config: &PassivityConfig) -> Passivity {
    Passivity::new(config, &DeviceSpec { delay_ticks: Some(0), ..strong_spec() }, PERIOD).unwrap()
}

/// A layer whose account is overdrawn by `debt` (J).
fn in_debt(layer: &Passivity, debt: f64) -> PassivityState {
    let mut state = PassivityState::default();
    layer.observe(&mut state, &Isometry3::identity());
    layer.keep(&mut state, &Wrench::from_force(Vector3::x()), true, PERIOD);
    layer.observe(&mut state, &Isometry3::translation(debt, 0.0, 0.0));
    layer.keep(&mut state, &Wrench::zero(), true, PERIOD);
    assert!((state.energy().account + debt).abs() < 1e-15);
    state
}

#[test]
fn it_acts_exactly_where_the_account_would_be_overdrawn_and_the_hand_moves() {
    let config = PassivityConfig::default();
    let layer = layer(&config);
    let wanted = Wrench::from_force(Vector3::x() * 2.0);
    let moving = |v: f64| Twist { linear: Vector3::x() * v, ..Twist::default() };
    let act = |debt: f64, velocity: Twist| {
        let mut flags = TickFlags::default();
        let left = layer.act(&in_debt(&layer, debt), &wanted, &velocity, PERIOD, &mut flags);
        assert_eq!(flags.contains(TickFlags::PASSIVITY), left != wanted);
        left.force.x
    };
    // 2 N at 0.1 m/s take 0.2 mJ in the tick to come.
    let room = config.allowance - 2.0 * 0.1 * PERIOD;
    assert_eq!(act(room - 1e-9, moving(0.1)), 2.0);
    let slightly = act(room + 1e-7, moving(0.1));
    // Exactly the lack is taken: 1e-7 J over the way of 1e-4 m.
    assert!((2.0 - slightly - 1e-7 / (0.1 * PERIOD)).abs() < 1e-9, "{slightly}");
    // A large debt takes all that pushes, and brakes by the damping's bound, which is 2.5 of the device's 5 N s/m.
    assert!((act(0.05, moving(0.1)) - -0.25).abs() < 1e-12);
    // Not from a slow hand: 0.1 kg behind half a tick and 1.6 ms of the velocity bear 0.1 / (2 * 2.1e-3) N s/m.
    let bearable = 0.1 / 4.2e-3;
    assert!((act(0.05, moving(0.05)) - (2.0 - bearable * 0.05)).abs() < 1e-12);
    // A hand that goes against the force is braked by the bound alone.
    assert!((act(0.05, moving(-0.1)) - 2.25).abs() < 1e-12);
    // Slow, half awake, at rest.
    assert_eq!(act(0.05, moving(0.999e-2)), 2.0);
    assert!((act(0.05, moving(1.5e-2)) - (2.0 - 0.5 * bearable * 1.5e-2)).abs() < 1e-12);
    assert_eq!(act(0.05, Twist::default()), 2.0);
    let mut flags = TickFlags::default();
    assert_eq!(layer.act(&in_debt(&layer, 0.05), &Wrench::zero(), &moving(0.1), PERIOD, &mut flags), Wrench::zero());
}

#[test]
fn what_a_tick_that_is_late_may_give_out_is_predicted_over_its_own_time() {
    let config = PassivityConfig::default();
    let layer = layer(&config);
    let wanted = Wrench::from_force(Vector3::x() * 2.0);
    let moving = Twist { linear: Vector3::x() * 0.1, ..Twist::default() };
    let left =
        |debt: f64, dt: f64| layer.act(&in_debt(&layer, debt), &wanted, &moving, dt, &mut TickFlags::default()).force.x;
    // 0.2 W for 3 ms; an early tick counts as one period.
    let room = |dt: f64| config.allowance - 0.2 * dt;
    for (dt, held) in [(3.0 * PERIOD, 3.0 * PERIOD), (0.3 * PERIOD, PERIOD)] {
        assert_eq!(left(room(held) - 1e-9, dt), 2.0);
        assert!((2.0 - left(room(held) + 1e-7, dt) - 1e-7 / (0.1 * held)).abs() < 1e-9);
    }
    // And what a mass bears is less behind a longer hold.
    assert!((left(0.05, 3.0 * PERIOD) - (2.0 - 0.1 / (2.0 * 3.1e-3) * 0.1)).abs() < 1e-12);
}

#[test]
fn without_motors_for_torque_no_torque_is_made() {
    let spec = DeviceSpec { max_torque: 0.0, ..strong_spec() };
    let layer = Passivity::new(&PassivityConfig::default(), &spec, PERIOD).unwrap();
    let state = in_debt(&layer_without_delay(&spec), 0.05);
    let mut flags = TickFlags::default();
    let turning = Twist { angular: Vector3::z() * 3.0, ..Twist::default() };
    let left = layer.act(&state, &Wrench::from_force(Vector3::x()), &turning, PERIOD, &mut flags);
    assert_eq!(left.torque, Vector3::zeros());
}

fn layer_without_delay(spec: &DeviceSpec) -> Passivity {
    Passivity::new(&PassivityConfig::default(), &DeviceSpec { delay_ticks: Some(0), ..spec.clone() }, PERIOD).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_wrench_never_grows_by_more_than_the_damping(
        f in prop::array::uniform3(-10.0..10.0_f64), v in prop::array::uniform3(-2.0..2.0_f64),
        torque in prop::array::uniform3(-0.1..0.1_f64), w in prop::array::uniform3(-9.0..9.0_f64), debt in -0.05..0.1_f64,
    ) {
        let layer = layer(&PassivityConfig::default());
        let wanted = Wrench { force: f.into(), torque: torque.into() };
        let motion = Twist { linear: v.into(), angular: w.into() };
        let mut flags = TickFlags::default();
        let left = layer.act(&in_debt(&layer, debt), &wanted, &motion, PERIOD, &mut flags);
        prop_assert!(left.is_finite());
        prop_assert!(left.force.norm() <= wanted.force.norm() + 2.5 * motion.linear.norm() + 1e-12);
        prop_assert!(left.torque.norm() <= wanted.torque.norm() + 0.01 * motion.angular.norm() + 1e-12);
        // What it takes, it takes from the motion; and never more than is lacking.
        let power = |w: &Wrench| w.force.dot(&motion.linear) + w.torque.dot(&motion.angular);
        let taken = PERIOD * (power(&wanted) - power(&left));
        prop_assert!(taken >= -1e-15);
        let lacking = (PERIOD * power(&wanted) + debt - 5e-4).max(0.0);
        prop_assert!(taken <= lacking + 1e-12, "{taken} J taken, {lacking} J lacking");
    }

    #[test]
    fn any_numbers_leave_a_finite_wrench_finite(
        v in prop::array::uniform3(prop::num::f64::ANY), w in prop::array::uniform3(prop::num::f64::ANY), debt in 0.0..0.1_f64,
    ) {
        let layer = layer(&PassivityConfig::default());
        let wanted = Wrench { force: Vector3::new(1.0, -2.0, 0.5), torque: Vector3::new(0.0, 0.1, 0.02) };
        let mut flags = TickFlags::default();
        let motion = Twist { linear: v.into(), angular: w.into() };
        let left = layer.act(&in_debt(&layer, debt), &wanted, &motion, PERIOD, &mut flags);
        prop_assert!(left.is_finite(), "{left:?}");
    }
}
