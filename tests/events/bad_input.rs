//! Mistakes in events are told with their place and a remedy before anything runs.

use crate::block;
use std::path::Path;

use palpate::scene::{Scene, SceneError};
use palpate::world::World;

/// The scene of the other tests with more in its body and at its end.
fn build(body: &str, rest: &str) -> Result<World, SceneError> {
    let text = block::TOML.replace("density = 1000\n", &format!("density = 1000\n{body}\n"));
    Scene::from_toml(&format!("{text}\n{rest}"), Path::new(""))?.build()
}

fn refused(body: &str, rest: &str, words: &[&str]) {
    let error = build(body, rest).err().unwrap_or_else(|| panic!("{body} {rest} is accepted"));
    assert!(matches!(error, SceneError::Invalid(_)), "{error:?}");
    let told = error.to_string();
    for word in words {
        assert!(told.contains(word), "`{word}` is missing: {told}");
    }
}

#[test]
fn events_that_cannot_be_are_refused_with_a_remedy() {
    let event = |text: &str| format!("[[event]]\n{text}\n");
    let z_min = r#"{ node_set = "z_min" }"#;
    refused("", &event("time = -0.1\nrelease = { node_set = \"z_min\" }"), &["time", "positive"]);
    refused("", &event("time = nan\nrelease = { node_set = \"z_min\" }"), &["time"]);
    refused("", &event("time = 0.1"), &["changes nothing", "release"]);
    refused("", &event("time = 0.1\ncut = { node_set = \"z_min\" }"), &["cut"]);
    refused("", &event("time = 0.1\nrelease = { node_set = \"z_mix\" }"), &["z_mix", "z_min"]);
    let far = "{ ball = { center = [1, 1, 1], radius = 0.1 } }";
    refused("", &event(&format!("time = 0.1\nhold = {far}")), &["no node", "spans"]);
    refused("", &event(&format!("time = 0.1\nremove = {far}")), &["no element", "spans"]);
    refused("", &event("time = 0.1\nremove = { region = \"bone\" }"), &["bone"]);
    refused("", &event("time = 0.1\nremove = { ball = { center = [0, 0, 0], radius = -1 } }"), &["radius"]);
    refused("", &event("time = 0.1\nrelease = { node_set = \"z_max\" }"), &["held", "release"]);
    refused("", &event(&format!("time = 0.1\nhold = {z_min}")), &["held already"]);
    let all = "{ above = { axis = \"z\", at = -1 } }";
    refused("", &event(&format!("time = 0.1\nremove = {all}")), &["last element"]);
    refused("", &event(&format!("time = 0.1\nhold = {all}")), &["nothing can move"]);
    let twice = event("time = 0.2\nremove = { above = { axis = \"z\", at = 0.03 } }").repeat(2);
    refused("", &twice, &["gone by then"]);
}

#[test]
fn methods_that_a_changing_body_does_not_go_with_are_refused() {
    let event = "[[event]]\ntime = 0.1\nrelease = { node_set = \"z_min\" }";
    refused("integrator = \"newton\"", event, &["newton", "backward_euler"]);
    refused("integrator = \"explicit\"", event, &["explicit", "backward_euler"]);
    refused("element = \"averaged\"", event, &["averaged", "quadratic"]);
}

#[test]
fn events_are_told_in_the_order_of_their_times_and_late_ones_are_warned_of() {
    let later = "[[event]]\ntime = 5\nhold = { node_set = \"z_max\" }\n";
    let sooner = "[[event]]\ntime = 0\nremove = { above = { axis = \"x\", at = 0.07 } }\n";
    let world = build("", &format!("{later}{sooner}")).unwrap();
    assert_eq!(world.changes().iter().map(|change| change.time()).collect::<Vec<_>>(), [0.0, 5.0]);
    let understood = world.understood();
    let (first, second) = (understood.find("event at 0 s: "), understood.find("event at 5 s: 49 nodes held"));
    assert!(first.is_some() && first < second, "{understood}");
    assert!(world.warnings().iter().any(|w| w.contains("5 s is after the end")), "{:?}", world.warnings());
}
