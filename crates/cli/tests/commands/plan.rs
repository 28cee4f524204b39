//! `palpate plan` prints what was chosen, and the times beside it.

use crate::program_runs::{Place, SCENE};

/// The scene with a line in its body.
fn place(line: &str) -> Place {
    Place::with(&SCENE.replace("density = 1060", &format!("density = 1060\n{line}")))
}

#[test]
fn the_choice_and_its_times_are_printed() {
    let told = Place::new().run("plan scene.toml --measure");
    assert_eq!(told.code, Some(0), "{told:?}");
    for words in [
        "exact compliance, factored in every step, no factor thread",
        "factorisation, in every step",
        "one solve with the factor",
        "free motion",
        "whole step, the tool where it begins",
        "time that a step has",
        "to the step",
        "error of the compliance: none",
    ] {
        assert!(told.out.contains(words), "{words}: {}", told.out);
    }
    assert!(!told.out.contains("also for the factor"), "{}", told.out);
    assert!(!Place::new().run("plan scene.toml").out.contains("whole step"), "nothing is stepped unasked");
}

/// With an accuracy: the methods in their order, in `check` too, and a word where exact steps have no room.
#[test]
fn an_accuracy_is_shown_with_the_methods_that_keep_it() {
    let place = place("accuracy = 0.02");
    let told = place.run("plan scene.toml");
    let ladder = "accuracy 0.02 by the lowest that meets it of: async < async, early refresh < exact";
    assert!(told.out.contains(ladder) && told.out.contains("also for the factor"), "{}", told.out);
    assert!(told.out.contains("async, early refresh: compliance and correction of 10 contacts"), "{}", told.out);
    let told = place.run("check scene.toml").out;
    assert!(told.contains("compliance async and more exact where the accuracy asks for it"), "{told}");
    assert!(!told.contains("may be missed"), "{told}");

    // Too many nodes for steps of a tenth of a millisecond.
    let large = place.text("scene.toml").replace("cells = [3, 3, 2]", "cells = [8, 8, 4]");
    place.write("scene.toml", &format!("{large}\n[rates]\nstep = 10000\ntick = 10000\n"));
    for command in ["check", "plan"] {
        let told = place.run(&format!("{command} scene.toml")).out;
        assert!(told.contains("accuracy = 0.02 may be missed") && told.contains("no step is exact"), "{told}");
    }
}
