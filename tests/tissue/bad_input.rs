//! Mistakes in a material are told at the key or value that is wrong, not at the whole table.

use crate::block;
use std::path::Path;

use palpate::scene::{Scene, SceneError};

const MATERIAL: &str = r#"material = { law = "neo_hookean", young = 6e3, poisson = 0.45 }"#;

/// What of the block's text, with this in the place of its material and that behind its body, its mistake points at, and the
/// message.
fn pointed(material: &str, table: &str) -> (String, String) {
    assert!(block::TOML.contains(MATERIAL));
    let text = block::TOML.replace(MATERIAL, material).replacen("[[tool]]", &format!("{table}\n[[tool]]"), 1);
    let built = Scene::from_toml(&text, Path::new("")).and_then(|scene| scene.build());
    match built.err() {
        Some(SceneError::Invalid(mistake)) => (mistake.text[mistake.span.clone()].into(), mistake.message.clone()),
        other => panic!("{material} {table}: {other:?}"),
    }
}

#[test]
fn each_mistake_of_a_material_is_shown_where_it_stands() {
    let viscous = "law = \"corotational\", young = 6e3, poisson = 0.4, viscosity";
    for (entries, place) in [
        ("law = \"neo_hookean\", young = -6e3, poisson = 0.45".to_owned(), "-6e3"),
        ("law = \"neo_hookean\", young = 6e3, poisson = 0.5".into(), "0.5"),
        ("law = \"neo_hookean\", mu = -2, k0 = 5e3".into(), "-2"),
        ("law = \"neo_hookean\", mu = 2e3, k0 = -5e3".into(), "-5e3"),
        ("law = \"mooney_rivlin\", young = 6e3, poisson = 0.45, share = 2.5".into(), "share"),
        ("law = \"neo_hooken\", young = 6e3, poisson = 0.45".into(), "\"neo_hooken\""),
        ("law = \"neo_hookean\", youn = 6e3, poisson = 0.45".into(), "youn"),
        ("law = \"neo_hookean\", young = \"6 kPa\", poisson = 0.45".into(), "\"6 kPa\""),
        ("law = \"ogden\", young = [1.0, 2.0], poisson = 0.4".into(), "[1.0, 2.0]"),
        (format!("{viscous} = [{{ modulus = 0.2, time = 1 }}, {{ modulus = 1.5, time = 1 }}]"), "1.5"),
        (format!("{viscous} = [{{ modulus = 0.2, time = -1 }}]"), "-1"),
        (format!("{viscous} = [{{ modulus = 0.6, time = 1 }}, {{ modulus = 0.7, time = 2 }}]"), "[{ modulus"),
    ] {
        let (inline, message) = pointed(&format!("material = {{ {entries} }}"), "");
        assert!(inline.starts_with(place) && inline.len() < entries.len(), "{entries}: {message}: at `{inline}`");
    }
}

#[test]
fn a_material_in_a_table_of_its_own_is_shown_by_line() {
    for (entries, place) in [
        ("law = \"neo_hookean\"\nyoung = 6e3\npoisson = 0.7", "0.7"),
        ("law = \"neo_hookean\"\nyung = 6e3\npoisson = 0.4", "yung"),
    ] {
        let (found, message) = pointed("", &format!("[body.material]\n{entries}"));
        assert_eq!(found, place, "{message}");
    }
}

#[test]
fn a_set_of_parameters_that_is_not_whole_is_a_mistake_of_the_table() {
    let (found, message) = pointed("material = { law = \"neo_hookean\", young = 6e3 }", "");
    assert!(found.starts_with('{') && message.contains("one complete set"), "{message}: at `{found}`");
}
