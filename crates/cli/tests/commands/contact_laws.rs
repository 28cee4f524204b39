//! Laws of contact by the program: `check` names them, a run tells them, and its trace replays to the bit.

use crate::program_runs::{Place, SCENE};

#[test]
fn every_law_is_checked_run_and_replayed() {
    for (contact, said) in [
        ("friction = 0.3", "law coulomb, friction 0.3"),
        ("friction = 0", "law signorini, no friction"),
        ("law = \"signorini\"", "law signorini, no friction"),
        ("law = \"faceted_coulomb\"\nfriction = 0.3\nfacets = 4", "law faceted_coulomb, friction 0.3 on 4 facets"),
        ("law = \"tresca\"\nlimit = 0.05", "law tresca, friction of at most 0.05 N a contact"),
        ("law = \"threshold\"\nlimit = 0.05", "law threshold, gives way at 0.05 N a contact, no friction"),
    ] {
        let place = Place::with(&SCENE.replace("friction = 0.3", contact));
        let check = place.run("check scene.toml");
        assert_eq!(check.code, Some(0), "{contact}: {check:?}");
        assert!(check.out.contains(said), "{contact}: {}", check.out);
        let run = place.run("run scene.toml --lockstep --quiet");
        assert_eq!(run.code, Some(0), "{contact}: {run:?}");
        assert!(run.out.contains(said) && run.out.contains("steps in contact by solver"), "{contact}: {}", run.out);
        let replay = place.run("replay small.mcap");
        assert_eq!(replay.code, Some(0), "{contact}: {replay:?}");
    }
}

#[test]
fn a_law_that_a_method_does_not_know_is_refused_with_its_line() {
    let place = Place::with(&SCENE.replace("friction = 0.3", "law = \"tresca\"\nlimit = 1\nmethod = \"penalty\""));
    let check = place.run("check scene.toml");
    assert_eq!(check.code, Some(2), "{check:?}");
    for word in ["scene.toml:18", "`penalty`", "`tresca`", "compliance"] {
        assert!(check.err.contains(word), "{word}: {}", check.err);
    }
}

/// What a method does not read is refused, and so are springs whose force is rounding.
#[test]
fn settings_without_effect_and_springs_beyond_reason_are_refused() {
    let cases: &[(&str, &str, &[&str])] = &[
        ("method = \"penalty\"", "kind = \"lemke\"", &["kind = \"lemke\"", "no effect", "`penalty`"]),
        ("method = \"lagrange\"", "relaxation = 0.5", &["relaxation = 0.5", "no effect", "`lagrange`"]),
        ("method = \"penalty\"", "sweep_order = \"symmetric\"", &["sweep_order", "no effect"]),
        ("method = \"penalty\"\npenalty = { stiffness = 10, multiple = 5 }", "", &["multiple = 5", "no effect"]),
        ("method = \"penalty\"\npenalty = { stiffness = 1e14 }", "", &["stiffness = 1e14", "rounding", "1e11"]),
        ("method = \"penalty\"\npenalty = { multiple = 1e300 }", "", &["multiple = 1e300", "rounding", "1e9"]),
    ];
    for (contact, solver, words) in cases {
        let scene = SCENE.replace("friction = 0.3", &format!("friction = 0.3\n{contact}"));
        let check = Place::with(&format!("{scene}\n[solver]\n{solver}\n")).run("check scene.toml");
        assert_eq!(check.code, Some(2), "{contact} {solver}: {check:?}");
        for word in *words {
            assert!(check.err.contains(word), "{contact} {solver}: {word} in {}", check.err);
        }
    }
    for method in ["penalty", "lagrange"] {
        let scene = SCENE.replace("friction = 0.3", &format!("friction = 0.3\nmethod = \"{method}\""));
        let check = Place::with(&scene).run("check scene.toml");
        assert_eq!(check.code, Some(0), "{check:?}");
        assert!(
            check.out.contains(&format!("solver: {method} to 1e-6")) && !check.out.contains("automatic\""),
            "{}",
            check.out
        );
    }
}

/// What a scene may name is listed where one looks for it.
#[test]
fn help_and_scenes_list_laws_methods_and_solvers() {
    let place = Place::new();
    for command in ["scenes", "run --help", "check --help"] {
        let listed = place.run(command);
        assert_eq!(listed.code, Some(0), "{listed:?}");
        for word in [
            "faceted_coulomb",
            "tresca",
            "threshold",
            "lagrange",
            "semismooth_newton",
            "ogden",
            "matching",
            "warped",
            "accuracy",
        ] {
            assert!(listed.out.contains(word), "{command}: {word} in {}", listed.out);
        }
    }
    for command in ["solve", "check", "plan", "chart", "run"] {
        let help = place.run(&format!("{command} --help"));
        assert!(help.out.contains("Examples:\n  palpate "), "{command}: {}", help.out);
    }
    assert!(place.run("solve --help").out.contains("1e-6"));
}
