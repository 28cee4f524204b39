//! What the force jumps by when a new snapshot comes: the bundled liver in lockstep, by what the tick works on.

use palpate::prelude::*;
use palpate::scene::TickMethod;

use crate::table::{MILLINEWTONS, head, line};

/// Runs the liver for `seconds` of virtual time by each method.
pub(crate) fn measure(seconds: f64) {
    head("jump of the force at a snapshot");
    for (what, method, hand_over) in [
        ("frozen rows", TickMethod::Frozen, None),
        ("local, no hand-over", TickMethod::Local, Some(0.0)),
        ("local, over 10 ms", TickMethod::Local, Some(10e-3)),
        ("local, over 33 ms", TickMethod::Local, Some(33e-3)),
    ] {
        let mut scene = Scene::bundled("liver").expect("the scene is bundled");
        let edited = scene.edit(|scene| {
            scene.tick.method = method;
            scene.tick.hand_over = hand_over.unwrap_or(scene.tick.hand_over);
        });
        let world = edited.and_then(|()| scene.build()).expect("the change is valid");
        let options = RunOptions { length: Length::Seconds(seconds), lockstep: true, ..RunOptions::default() };
        let outcome = run(&world, &options, &AtomicBool::new(false), &mut Unobserved).expect("the scene runs");
        let s = &outcome.summary;
        let note = format!("of up to {:.2} N; to reach: 5 % of the force or 20", s.largest_force);
        line(what, &s.force_jump, MILLINEWTONS, &note);
    }
}
