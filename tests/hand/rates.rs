//! Rates at which no force can reach the hand are told before anything runs.

#![allow(clippy::print_stdout)] // what is said

use std::sync::atomic::AtomicBool;

use palpate::prelude::*;
use palpate::run::{Length, RunOptions, Unobserved, run};
use palpate::scene::SceneError;

use crate::block::{TOML, record, world};

fn options() -> RunOptions {
    RunOptions { length: Length::Seconds(0.9), lockstep: true, threads: Some(1), ..RunOptions::default() }
}

#[test]
fn ticks_that_are_all_gaps_are_refused_with_both_keys() {
    let with = |text: &str| Scene::from_toml(&format!("{TOML}\n{text}"), std::path::Path::new(""));
    for (text, place) in [
        ("[limits]\ngap = 0.001\n", "0.001"),
        ("[limits]\ngap = 0.0005\n", "0.0005"),
        ("[rates]\nstep = 5\ntick = 20\n", "20"),
        ("[rates]\nstep = 5\ntick = 15\n", "15"),
    ] {
        let Err(SceneError::Invalid(error)) = with(text) else { panic!("accepted: {text}") };
        let said = error.to_string();
        println!("{said}");
        assert!(said.contains("rates.tick") && said.contains("limits.gap"), "{said}");
        assert_eq!(&error.text[error.span.clone()], place, "{said}");
        assert!(error.remedy.is_some_and(|remedy| remedy.contains("above")));
    }
    assert!(with("[rates]\nstep = 5\ntick = 21\n").is_ok());
    // The force of such ticks does rise: the bound is the true one.
    let slow = world(|scene| {
        (scene.rates.step, scene.rates.tick) = (10.0, 25.0);
        scene.device.kind = "scripted".into();
    });
    let (outcome, _) = record(&slow, &options());
    assert!(outcome.summary.largest_force > 0.05, "{}", outcome.summary.largest_force);
}

#[test]
fn steps_that_let_every_snapshot_grow_stale_are_warned_of_and_not_run_where_none_lasts() {
    let at = |change: fn(&mut SceneDescription)| {
        let world = world(change);
        let warned = world.warnings().iter().find(|w| w.contains("rates.step")).cloned();
        (run(&world, &options(), &AtomicBool::new(false), &mut Unobserved).err().map(|e| e.to_string()), warned)
    };
    assert_eq!(at(|scene| scene.rates.step = 5.1), (None, None));
    let (refused, warned) = at(|scene| scene.rates.step = 5.0);
    let warned = warned.expect("warned of");
    println!("{warned}");
    assert!(warned.contains("limits.stale_after = 0.2 s") && warned.contains("rates.step = 5 Hz"), "{warned}");
    assert_eq!(refused, None);
    for change in [
        |scene: &mut SceneDescription| scene.rates.step = 2.0,
        |scene: &mut SceneDescription| {
            (scene.limits.stale_after, scene.limits.stale_zero) = (0.01, 0.03);
        },
    ] {
        let (refused, warned) = at(change);
        println!("{refused:?}");
        assert!(refused.as_ref().is_some_and(|said| said.contains("limits.stale_zero")), "{refused:?}");
        assert_eq!(refused, warned, "check says what the run says");
    }
}
