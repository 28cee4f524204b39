//! Hand scripts: what they mean, and what is refused.

use nalgebra::{UnitQuaternion, Vector3};
use palpate_collision::Turn;
use palpate_haptics::SetupError;
use palpate_haptics::device::{HapticDevice, ScriptedDevice, TickTime, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::hand::Hand;
use palpate_haptics::script::{HandScript, ScriptKey};

fn key(time: f64, x: f64) -> ScriptKey {
    ScriptKey { time, position: [x, 0.0, 0.0], ..ScriptKey::default() }
}

#[test]
fn motion_is_minimum_jerk_with_its_own_derivative() {
    let script = HandScript::new(vec![key(0.0, 0.0), key(0.5, 0.02), key(0.7, 0.02), key(1.0, -0.01)]).unwrap();
    let h = 1e-6;
    for i in 1..1000 {
        let t = f64::from(i) * 1.1e-3;
        let near_entry = [0.5, 0.7, 1.0].iter().any(|entry: &f64| (t - entry).abs() < 2.0 * h);
        let slope = (script.intent(t + h).position.x - script.intent(t - h).position.x) / (2.0 * h);
        // Central difference: error h² x'''/6 < 1e-12 m/s, rounding 1e-18/1e-6.
        assert!(near_entry || (script.intent(t).velocity.x - slope).abs() < 1e-9, "at {t} s");
    }
    let peak = (0..500).map(|i| script.intent(f64::from(i) * 1e-3).velocity.x).fold(0.0, f64::max);
    assert!((peak - 1.875 * 0.02 / 0.5).abs() < 1e-9);
    assert_eq!(script.intent(0.25).position.x, 0.01);
    assert_eq!(script.intent(-1.0).position.x, 0.0);
    assert_eq!(script.intent(0.6).velocity, Vector3::zeros());
    assert_eq!(script.intent(50.0).position.x, -0.01);
    assert_eq!(script.intent(50.0).velocity, Vector3::zeros());
}

#[test]
fn gestures_join_end_to_end() {
    let script = HandScript::at(Vector3::z() * 0.01)
        .move_to(Vector3::zeros(), 0.3)
        .and_then(|s| s.hold(0.1))
        .and_then(|s| s.tap(Vector3::x() * 0.01, 0.2))
        .and_then(|s| s.let_go(0.4))
        .and_then(|s| s.move_to(Vector3::y() * 0.01, 0.5))
        .unwrap();
    assert!((script.duration() - 1.5).abs() < 1e-12);
    assert!((script.intent(0.5).position - Vector3::x() * 0.01).norm() < 1e-12);
    assert!(script.intent(0.59).grip);
    assert!(!script.intent(0.8).grip);
    assert!(script.intent(1.01).grip);
    assert_eq!(script.intent(2.0).position, Vector3::y() * 0.01);
}

#[test]
fn scripts_that_cannot_be_followed_are_refused_by_entry() {
    let refused = |keys: Vec<ScriptKey>| HandScript::new(keys).unwrap_err();
    assert_eq!(refused(vec![]), SetupError::EmptyScript);
    assert!(matches!(refused(vec![key(0.5, 0.0)]), SetupError::ScriptGap { entry: 0, .. }));
    let unordered = refused(vec![key(0.0, 0.0), key(0.5, 0.0), key(0.5, 0.1)]);
    assert!(matches!(unordered, SetupError::ScriptOrder { entry: 2, .. }));
    assert!(unordered.to_string().contains("entry 2 is at 0.5 s, not after the 0.5 s of entry 1"));
    let millimetres = refused(vec![key(0.0, 0.0), key(0.5, 20.0)]);
    assert!(matches!(millimetres, SetupError::ScriptSpeed { entry: 1, .. }));
    assert!(millimetres.to_string().contains("millimetres"));
    let nan = refused(vec![key(0.0, 0.0), key(0.5, f64::NAN)]);
    assert!(matches!(nan, SetupError::ScriptNumber { entry: 1, what: "x", .. }));
    assert!(matches!(refused(vec![key(f64::NAN, 0.0)]), SetupError::ScriptNumber { entry: 0, what: "time", .. }));
}

#[test]
fn text_is_validated_as_it_is_read() {
    let text = r#"[{"time": 0, "position": [0, 0, 0]}, {"time": 1, "position": [0, 0, 0.01], "release": true}]"#;
    let script: HandScript = serde_json::from_str(text).unwrap();
    assert!(!script.intent(1.5).grip);
    assert_eq!(serde_json::from_str::<HandScript>(&serde_json::to_string(&script).unwrap()).unwrap(), script);
    let gap = serde_json::from_str::<HandScript>(r#"[{"time": 0.2, "position": [0, 0, 0]}]"#).unwrap_err();
    assert!(gap.to_string().contains("the first entry must be at time 0"), "{gap}");
    assert!(serde_json::from_str::<HandScript>(r#"[{"time": 0, "position": [0, 0, 0], "speed": 1}]"#).is_err());
}

#[test]
fn orientation_and_gripper_go_from_entry_to_entry_and_the_angular_velocity_is_their_derivative() {
    let turned = |time, turn: Option<Turn>, gripper| ScriptKey { rotation: turn, gripper, ..key(time, 0.0) };
    let script = HandScript::new(vec![
        turned(0.0, None, None),
        turned(1.0, Some(Turn::about(Vector3::new(0.0, 3.0, 4.0), 120.0)), Some(0.25)),
        turned(2.0, None, None),
        turned(3.0, Some(Turn::Quaternion([0.5, 0.5, -0.5, 0.5])), Some(1.0)),
        // The shorter way from a quaternion to its opposite is none.
        turned(4.0, Some(Turn::Quaternion([-0.5, -0.5, 0.5, -0.5])), None),
    ])
    .unwrap();
    assert_eq!((script.intent(0.0).rotation, script.intent(0.0).gripper), (UnitQuaternion::identity(), 1.0));
    // Half way in time is half way round, about the same axis.
    let half = script.intent(0.5);
    let (axis, angle) = half.rotation.axis_angle().unwrap();
    assert!(
        (axis.into_inner() - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-14 && (angle - 60f64.to_radians()).abs() < 1e-14
    );
    assert!((half.gripper - 0.625).abs() < 1e-15);
    // Peak of the minimum-jerk profile: 15/8 of the mean.
    assert!((half.angular_velocity.norm() - 1.875 * 120f64.to_radians()).abs() < 1e-12);
    let (rest, same) = (script.intent(1.5), script.intent(1.0));
    assert_eq!((rest.rotation, rest.gripper, rest.angular_velocity), (same.rotation, 0.25, Vector3::zeros()));
    assert!(script.intent(3.5).angular_velocity.norm() < 1e-12);
    for k in 1..40 {
        let (t, e) = (0.1 * f64::from(k) + 0.013, 1e-6);
        let (a, b) = (script.intent(t - e), script.intent(t + e));
        let difference = (b.rotation * a.rotation.inverse()).scaled_axis() / (2.0 * e);
        // The difference quotient is good to e² times the third derivative, and to rounding over e.
        let off = difference - script.intent(t).angular_velocity;
        assert!(off.norm() < 1e-8, "{t} s: {off:?}");
    }
}

#[test]
fn a_rotation_without_direction_and_a_gripper_beyond_its_range_name_their_entry() {
    let wrong = ScriptKey { rotation: Some(Turn::Quaternion([0.0; 4])), ..key(1.0, 0.0) };
    assert_eq!(HandScript::new(vec![key(0.0, 0.0), wrong]), Err(SetupError::ScriptRotation { entry: 1 }));
    for value in [-0.1, 1.5, f64::NAN] {
        let wrong = ScriptKey { gripper: Some(value), ..key(0.0, 0.0) };
        let error = HandScript::new(vec![wrong]).unwrap_err();
        assert!(matches!(error, SetupError::ScriptGripper { entry: 0, .. }), "{error}");
    }
}

/// Both devices that need no hardware follow the script's rotation and gripper exactly.
#[test]
fn devices_turn_with_the_script() {
    let end = ScriptKey { rotation: Some(Turn::about(Vector3::x(), 70.0)), gripper: Some(0.0), ..key(1.0, 0.1) };
    let script = HandScript::new(vec![key(0.0, 0.0), end]).unwrap();
    let hand = Hand::preset("firm").unwrap();
    let mut virtual_device = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script.clone()).unwrap();
    let mut scripted = ScriptedDevice::new(script.clone());
    for index in 0..1000 {
        let tick = TickTime::regular(index, 1e-3);
        let intent = script.intent(tick.time);
        for device in [&mut virtual_device as &mut dyn HapticDevice, &mut scripted] {
            let sample = device.read(tick).unwrap();
            assert_eq!((sample.pose.rotation, sample.gripper), (intent.rotation, intent.gripper));
            assert_eq!(sample.velocity.angular, intent.angular_velocity);
        }
    }
}
