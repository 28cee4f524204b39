//! Values that are possible but probably in another unit: the scene runs, and `check` says so.

use crate::program_runs::{Place, SCENE};

#[test]
fn values_in_another_unit_are_warned_of() {
    // What is changed, to what, and what the warning says.
    let cases: &[(&str, &str, &[&str])] = &[
        ("young = 10e3", "young = 1.0", &["shear modulus of 3.6e-1 Pa", "in Pa?"]),
        ("young = 10e3", "young = 1e13", &["the body: a shear modulus", "in Pa?"]),
        ("density = 1060", "density = 1.06", &["density = 1.06 kg/m³", "about 1,000"]),
        ("rayleigh_stiffness = 0.005", "rayleigh_stiffness = 5", &["rayleigh_stiffness = 5 s", "milliseconds?"]),
        ("friction = 0.3", "margin = 4", &["contact.margin = 4 m", "0.090 m across", "in metres?"]),
        // A tool that begins a little within the skin is pushed out by the first step.
        ("radius = 0.01 }", "radius = 0.014 }", &["begins 2.0 mm within the skin"]),
    ];
    for (from, to, words) in cases {
        assert_eq!(SCENE.matches(from).count(), 1, "{from}");
        let place = Place::with(&SCENE.replace(from, to));
        let check = place.run("check scene.toml");
        assert_eq!(check.code, Some(0), "{to}: {check:?}");
        let warning = check.out.lines().find(|line| line.starts_with("warning: ")).unwrap_or_default();
        for word in *words {
            assert!(warning.contains(word), "{to}: no `{word}` in {}", check.out);
        }
    }
    let check = Place::new().run("check scene.toml");
    assert!(!check.out.contains("warning"), "{}", check.out);
}

/// The place is where the hand begins; the remedy names what is likely behind it.
#[test]
fn a_tool_that_begins_deep_in_the_body_is_refused() {
    let cases: &[(&str, &str, &[&str])] = &[
        ("radius = 0.01 }", "radius = 0.03 }", &["begins 18.0 mm within the skin", "outside the skin"]),
        ("radius = 0.01 }", "radius = 10.0 }", &["within the skin", "the tool is 34.641 m across", "in metres?"]),
        (
            "max = [0.03, 0.03, 0.03]",
            "max = [30, 30, 30]",
            &["begins inside the body", "the mesh would be", "`scale = 0.001`"],
        ),
    ];
    for (from, to, words) in cases {
        assert_eq!(SCENE.matches(from).count(), 1, "{from}");
        let place = Place::with(&SCENE.replace(from, to));
        for command in ["check scene.toml", "run scene.toml --lockstep --steps 1"] {
            let run = place.run(command);
            assert!(run.code == Some(2) && run.err.contains("scene.toml:24:5"), "{to}: {run:?}");
            for word in *words {
                assert!(run.err.contains(word), "{to}: no `{word}` in {}", run.err);
            }
        }
        assert_eq!(place.files(), ["scene.toml"], "{to}");
    }
}
