//! Keys of a device that its kind does not read are refused, each by its own name and at its own place.

use std::path::Path;

use palpate::scene::{Scene, SceneError};

use crate::block::TOML;

#[test]
fn a_place_of_a_device_in_arithmetic_is_refused_by_the_key_that_was_given() {
    let with = |line: &str| {
        Scene::from_toml(&TOML.replace("kind = \"virtual\"", &format!("kind = \"virtual\"\n{line}")), Path::new(""))
    };
    assert!(with("").is_ok());
    for (key, value) in [
        ("origin", "[0, 0, 0.1]"),
        ("axes", "[\"y\", \"-x\", \"z\"]"),
        ("url", "\"ws://localhost\""),
        ("gripper_range", "0.05"),
    ] {
        let Err(SceneError::Invalid(error)) = with(&format!("{key} = {value}")) else { panic!("accepted: {key}") };
        assert!(error.to_string().contains(&format!("`{key}` has no effect")), "{error}");
        assert_eq!(&error.text[error.span.clone()], value, "{error}");
    }
}

#[test]
fn a_gripper_opens_by_a_length() {
    let with = |range: &str| {
        let device = format!("kind = \"force_dimension\"\ngripper_range = {range}");
        Scene::from_toml(&TOML.replace("kind = \"virtual\"", &device), Path::new(""))
    };
    assert_eq!(with("0.05").unwrap().description().device.gripper_range, Some(0.05));
    for range in ["0.0", "-0.025", "nan"] {
        let Err(SceneError::Invalid(error)) = with(range) else { panic!("accepted: {range}") };
        assert!(error.to_string().contains("gripper_range") && error.text[error.span.clone()] == *range, "{error}");
    }
}
