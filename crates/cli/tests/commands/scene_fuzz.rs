//! Damaged scene texts: the reader answers with a scene or with a place in the text, and never panics.

use std::path::Path;

use palpate::scene::{BUNDLED_SCENES, Scene, SceneError};
use proptest::prelude::*;

/// What is put in place of a part of a scene.
fn piece() -> impl Strategy<Value = String> {
    const VALUES: &[&str] = &[
        "",
        "-1",
        "0",
        "nan",
        "inf",
        "-inf",
        "1e308",
        "1e400",
        "\"\"",
        "[]",
        "{}",
        "true",
        "=",
        "[",
        "]",
        "{",
        "}",
        "\n",
        "\"",
        "[[body]]",
        "[body]",
        "[[tool]]",
        "fixed = []",
        "x = 1",
        "é",
        "\u{0}",
        "18446744073709551616",
        ".",
        "0x",
        "#",
        "1979-05-27",
    ];
    prop_oneof![proptest::sample::select(VALUES).prop_map(String::from), "[ -~\n]{0,12}"]
}

/// A bundled scene with up to four parts replaced, each cut at boundaries of characters.
fn damaged() -> impl Strategy<Value = String> {
    let cut = (any::<prop::sample::Index>(), 0..40_usize, piece());
    (0..BUNDLED_SCENES.len(), prop::collection::vec(cut, 1..5)).prop_map(|(scene, cuts)| {
        let mut text: Vec<char> = BUNDLED_SCENES[scene].text.chars().collect();
        for (at, length, new) in cuts {
            let begin = at.index(text.len() + 1);
            let end = (begin + length).min(text.len());
            text.splice(begin..end, new.chars());
        }
        text.into_iter().collect()
    })
}

/// A bundled scene with one number replaced: most of these are TOML, so they reach the checks of the values.
fn other_number() -> impl Strategy<Value = String> {
    let number = prop_oneof![
        proptest::num::f64::ANY.prop_map(|v| format!("{v:?}").replace("NaN", "nan")),
        any::<i64>().prop_map(|v| v.to_string()),
        Just("0".to_string()),
    ];
    (0..BUNDLED_SCENES.len(), any::<prop::sample::Index>(), number).prop_map(|(scene, which, new)| {
        let text = BUNDLED_SCENES[scene].text;
        let is_part = |c: char| c.is_ascii_digit() || matches!(c, '.' | 'e' | '-');
        let starts: Vec<_> = text
            .char_indices()
            .filter(|&(i, c)| c.is_ascii_digit() && !text[..i].ends_with(|b: char| is_part(b) || b.is_alphanumeric()))
            .map(|(i, _)| i)
            .collect();
        let begin = starts[which.index(starts.len())];
        let end = text[begin..].find(|c| !is_part(c)).map_or(text.len(), |n| begin + n);
        format!("{}{new}{}", &text[..begin], &text[end..])
    })
}

fn answers(text: &str) -> Result<(), TestCaseError> {
    match Scene::from_toml(text, Path::new("")) {
        Ok(scene) => prop_assert!(scene.seconds() > 0.0),
        Err(SceneError::Invalid(e)) => {
            prop_assert!(!e.message.is_empty());
            let lines = text.split('\n').count();
            prop_assert!((1..=lines).contains(&e.line), "line {} of {lines}", e.line);
            prop_assert!(e.column >= 1 && e.span.start <= e.span.end && e.span.end <= text.len(), "{:?}", e.span);
            let place = format!("scene:{}:{}: ", e.line, e.column);
            prop_assert!(e.to_string().starts_with(&place), "{}", e);
        }
        Err(other) => prop_assert!(false, "{other}"),
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_text_is_refused_with_a_place(text in damaged()) {
        answers(&text)?;
    }

    #[test]
    fn any_number_is_taken_or_refused_with_a_place(text in other_number()) {
        answers(&text)?;
    }
}
