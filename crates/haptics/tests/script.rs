//! Hand scripts: what they mean, and what is refused.

use nalgebra::Vector3;
use palpate_haptics::SetupError;
use palpate_haptics::script::{HandScript, ScriptKey};

fn key(time: f64, x: f64) -> ScriptKey {
    ScriptKey { time, position: [x, 0.0, 0.0], release: false }
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
