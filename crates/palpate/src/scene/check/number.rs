//! Ranges of single numbers.

use super::super::parse::Source;
use super::super::readable::Readable;
use super::Checked;

pub(super) fn positive(source: &Source<'_>, path: &str, value: f64, unit: &str) -> Checked {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(source.at(
        path,
        format!("{} = {} {unit} is not a positive number", last(path), Readable(value)).replace("  ", " "),
        "give a positive number",
    ))
}

pub(super) fn not_negative(source: &Source<'_>, path: &str, value: f64, unit: &str) -> Checked {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(source.at(
        path,
        format!("{} = {} {unit} is negative or not finite", last(path), Readable(value)).replace("  ", " "),
        "give zero or a positive number",
    ))
}

pub(super) fn at_least_one(source: &Source<'_>, path: &str, value: usize) -> Checked {
    if value > 0 { Ok(()) } else { Err(source.at(path, format!("{} = 0", last(path)), "give at least 1")) }
}

pub(super) fn finite(source: &Source<'_>, path: &str, values: &[f64]) -> Checked {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(v) => Err(source.at(path, format!("{v} is not a finite number"), "give finite numbers")),
    }
}

fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}
