//! From TOML text to a description, with the place of every mistake.

use std::ops::Range;

use serde::Deserialize;
use toml::de::{DeTable, DeValue};

use super::argument::Before;
use super::culprit::culprit;
use super::description::SceneDescription;
use super::error::{SceneError, nearest};

/// A scene's text and its parsed tree, kept to point at values.
pub(super) struct Source<'a> {
    pub(super) origin: &'a str,
    pub(super) text: &'a str,
    /// Where the values come from, if the text was made of another one and of arguments.
    pub(super) before: Option<&'a Before>,
}

impl Source<'_> {
    /// Parses the text into a description.
    pub(super) fn parse(&self) -> Result<SceneDescription, SceneError> {
        if self.text.trim().is_empty() {
            let remedy = "copy a scene and change it; `palpate scenes` lists what it may name";
            return Err(SceneError::invalid(self.origin, self.text, 0..0, "the scene is empty", Some(remedy.into())));
        }
        let deserializer = toml::Deserializer::parse(self.text).map_err(|e| self.syntax(&e))?;
        SceneDescription::deserialize(deserializer).map_err(|e| self.syntax(&e))
    }

    fn syntax(&self, error: &toml::de::Error) -> SceneError {
        let message = error.message().trim().to_string();
        let remedy = suggestion(&message).or_else(|| kind_wanted(&message));
        let span = error.span().unwrap_or(0..0);
        let span = culprit(self.text, &span, &message).unwrap_or(span);
        SceneError::invalid(self.origin, self.text, span, message, remedy)
    }

    /// An error at the value of a key path such as `body.0.density`; at its parent where the key is absent.
    pub(super) fn at(&self, path: &str, message: impl Into<String>, remedy: impl Into<String>) -> SceneError {
        let remedy = Some(remedy.into());
        if let Some(argument) = self.before.and_then(|before| before.argument(path)) {
            return SceneError::invalid("command line", &argument.text, argument.value(), message, remedy);
        }
        let (origin, text) = self.before.map_or((self.origin, self.text), |before| (&before.origin, &before.text));
        SceneError::invalid(origin, text, Self::span(text, path), message, remedy)
    }

    fn span(text: &str, path: &str) -> Range<usize> {
        let Ok(root) = DeTable::parse(text) else { return 0..0 };
        let mut span = 0..0;
        let mut parts = path.split('.');
        let Some(first) = parts.next() else { return span };
        let Some((key, mut value)) = root.get_ref().iter().find(|(k, _)| k.get_ref() == first) else { return span };
        span = if matches!(value.get_ref(), DeValue::Table(_)) { key.span() } else { value.span() };
        for part in parts {
            let next = match value.get_ref() {
                DeValue::Table(table) => table.iter().find(|(k, _)| k.get_ref() == part).map(|(k, v)| (k.span(), v)),
                DeValue::Array(array) => part.parse().ok().and_then(|i: usize| array.get(i)).map(|v| (v.span(), v)),
                _ => None,
            };
            let Some((place, child)) = next else { break };
            span = if matches!(child.get_ref(), DeValue::Table(_)) { place } else { child.span() };
            value = child;
        }
        span
    }
}

/// What a value should be, where serde says it in words of Rust.
fn kind_wanted(message: &str) -> Option<String> {
    let wanted = message.rsplit_once("expected ")?.1;
    let remedy = match wanted {
        "f64" => {
            "give a number without a unit, as 1060.0; the comments of the bundled scenes name the unit of each key"
        }
        "u16" | "u32" | "u64" | "usize" => "give a whole number that is not negative",
        "an array of length 3" => "give three numbers, as [0.0, 0.0, 0.01]",
        "a boolean" => "give true or false",
        _ => return None,
    };
    Some(remedy.into())
}

/// Turns serde's "unknown field `x`, expected one of `a`, `b`" into "did you mean `a`?".
fn suggestion(message: &str) -> Option<String> {
    if !message.starts_with("unknown") {
        return None;
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let word = quoted.next()?;
    nearest(word, quoted).map(|best| format!("did you mean `{best}`?"))
}
