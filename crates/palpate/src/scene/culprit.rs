//! Which entry of a table a mistake is in, where the parser knows the table alone.
//!
//! A table that is read as one of several kinds, or checked as a whole, has lost the places of its entries by then. The
//! message still names the key or the value; where exactly one entry fits, it is the one.

use std::ops::Range;

use serde::de::Unexpected;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};

/// The place of the entry that `message` is about, in the table at `span` of `text`.
pub(super) fn culprit(text: &str, span: &Range<usize>, message: &str) -> Option<Range<usize>> {
    let root = DeTable::parse(text).ok()?;
    let mut values = root.get_ref().iter().flat_map(|(_, value)| with_inner(value));
    let whole = values.find(|value| value.get_ref().is_table() && value.span() == *span)?;
    let clue = Clue::of(message)?;
    let tables = with_inner(whole).into_iter().filter_map(|value| value.get_ref().as_table());
    let places: Vec<_> =
        tables.flat_map(|table| table.iter()).filter_map(|(key, value)| clue.place(key, value)).collect();
    match places.as_slice() {
        [place] => Some(place.clone()),
        _ => None,
    }
}

/// What a message tells of the entry.
enum Clue<'a> {
    /// A key that is not known.
    Key(&'a str),
    /// The key of a value that is refused: `young = -5000 Pa: ...`.
    ValueOf(&'a str),
    /// A name that is not known.
    Name(&'a str),
    /// A value of the wrong kind, as serde writes it.
    Value(&'a str),
}

impl<'a> Clue<'a> {
    fn of(message: &'a str) -> Option<Self> {
        let quoted = |rest: &'a str| rest.split('`').nth(1);
        if let Some(rest) = message.strip_prefix("unknown field ") {
            return quoted(rest).map(Self::Key);
        }
        if let Some(rest) = message.strip_prefix("unknown variant ") {
            return quoted(rest).map(Self::Name);
        }
        let wrong = message.strip_prefix("invalid type: ").or_else(|| message.strip_prefix("invalid value: "));
        if let Some(rest) = wrong {
            return rest.rsplit_once(", expected ").map(|(value, _)| Self::Value(value));
        }
        let (key, _) = message.split_once(" = ")?;
        key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_').then_some(Self::ValueOf(key))
    }

    fn place(&self, key: &Spanned<DeString<'_>>, value: &Spanned<DeValue<'_>>) -> Option<Range<usize>> {
        match self {
            Self::Key(wanted) => (key.get_ref() == wanted).then(|| key.span()),
            Self::ValueOf(wanted) => (key.get_ref() == wanted).then(|| value.span()),
            Self::Name(wanted) => (value.get_ref().as_str() == Some(wanted)).then(|| value.span()),
            Self::Value(wanted) => (told(value.get_ref()).as_deref() == Some(*wanted)).then(|| value.span()),
        }
    }
}

/// A value in the words of serde.
fn told(value: &DeValue<'_>) -> Option<String> {
    let told = match value {
        DeValue::String(text) => Unexpected::Str(text),
        DeValue::Integer(number) => Unexpected::Signed(number.as_str().parse().ok()?),
        DeValue::Float(number) => Unexpected::Float(number.as_str().parse().ok()?),
        DeValue::Boolean(value) => Unexpected::Bool(*value),
        DeValue::Array(_) => Unexpected::Seq,
        DeValue::Table(_) => Unexpected::Map,
        DeValue::Datetime(_) => return None,
    };
    Some(told.to_string())
}

/// A value and all that lie in it.
fn with_inner<'a>(value: &'a Spanned<DeValue<'a>>) -> Vec<&'a Spanned<DeValue<'a>>> {
    let mut all = vec![value];
    match value.get_ref() {
        DeValue::Array(array) => all.extend(array.iter().flat_map(with_inner)),
        DeValue::Table(table) => all.extend(table.iter().flat_map(|(_, value)| with_inner(value))),
        _ => {}
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What of `text` a message about its table `whole` points at.
    fn pointed<'a>(text: &'a str, whole: &str, message: &str) -> Option<&'a str> {
        let begin = text.find(whole).unwrap();
        culprit(text, &(begin..begin + whole.len()), message).map(|place| &text[place])
    }

    #[test]
    fn the_one_entry_that_fits_is_pointed_at() {
        let inline = "{ law = \"ogden\", young = -5.0, terms = [{ mu = true, n = 7 }] }";
        let text = format!("[[body]]\nname = \"ogden\"\nmaterial = {inline}\n");
        for (message, place) in [
            ("unknown field `young`, expected one of `young_`", "young"),
            ("unknown variant `ogden`, expected `a`", "\"ogden\""),
            ("invalid type: boolean `true`, expected f64", "true"),
            ("invalid type: integer `7`, expected a string", "7"),
            ("invalid value: floating point `-5.0`, expected more", "-5.0"),
            ("invalid type: sequence, expected f64", "[{ mu = true, n = 7 }]"),
            ("young = -5 Pa: it must be positive", "-5.0"),
        ] {
            assert_eq!(pointed(&text, inline, message), Some(place), "{message}");
        }
        for message in
            ["missing field `poisson`", "mu and k0 = no key: both", "invalid type: string \"b\", expected f64"]
        {
            assert_eq!(pointed(&text, inline, message), None, "{message}");
        }
        let text = "[a.material]\nyoung = 1\nmu = 1";
        assert_eq!(pointed(text, "[a.material]", "unknown field `mu`, expected `young`"), Some("mu"));
        assert_eq!(
            pointed(text, "[a.material]", "invalid type: integer `1`, expected a string"),
            None,
            "which of both"
        );
    }
}
