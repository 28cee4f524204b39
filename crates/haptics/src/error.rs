//! Mistakes of set-up, each with the value and the remedy.

use thiserror::Error;

/// A description that cannot be run. Found at set-up only.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SetupError {
    /// A number outside its range.
    #[error("{what} is {value}: it must be {range}")]
    OutOfRange {
        /// The field, with its unit.
        what: &'static str,
        /// What was given.
        value: f64,
        /// What is accepted.
        range: &'static str,
    },
    /// A name that no register holds.
    #[error("unknown {kind} `{name}`: known are {known}")]
    UnknownName {
        /// What kind of thing was asked for.
        kind: &'static str,
        /// The name given.
        name: String,
        /// The register's names.
        known: String,
    },
    /// A hand script without entries.
    #[error("the hand script is empty: give at least one entry with `time = 0` and a position")]
    EmptyScript,
    /// Nothing says where the hand is between two times.
    #[error(
        "hand script has a gap: entry {entry} is at {time} s, and nothing says where the hand is from {from} s on; {remedy}"
    )]
    ScriptGap {
        /// Index of the entry, from 0.
        entry: usize,
        /// The entry's time \[s\].
        time: f64,
        /// Start of the gap \[s\].
        from: f64,
        /// What to change.
        remedy: &'static str,
    },
    /// Times of a hand script that do not increase.
    #[error("hand script entry {entry} is at {time} s, not after the {previous} s of entry {before}: put entries in order of time", before = entry - 1)]
    ScriptOrder {
        /// Index of the entry, from 0 (always at least 1).
        entry: usize,
        /// The entry's time \[s\].
        time: f64,
        /// Time of the entry before \[s\].
        previous: f64,
    },
    /// A rotation without a direction in a hand script.
    #[error(
        "hand script entry {entry}: the rotation has no direction: give a quaternion [w, x, y, z] or {{ axis = [x, y, z], degrees = angle }} with an axis that is not zero"
    )]
    ScriptRotation {
        /// Index of the entry, from 0.
        entry: usize,
    },
    /// A gripper outside its range in a hand script.
    #[error("hand script entry {entry}: gripper is {value}: it must be 0 (closed) to 1 (open)")]
    ScriptGripper {
        /// Index of the entry, from 0.
        entry: usize,
        /// What was given.
        value: f64,
    },
    /// A number in a hand script that is not finite.
    #[error("hand script entry {entry}: {what} is {value}, not a finite number")]
    ScriptNumber {
        /// Index of the entry, from 0.
        entry: usize,
        /// Which number.
        what: &'static str,
        /// What was given.
        value: f64,
    },
    /// A hand script that no hand can follow.
    #[error(
        "hand script entry {entry} asks for {speed:.3} m/s ({distance:.4} m in {duration:.4} s), above {limit} m/s: is a position in millimetres, or an entry missing?"
    )]
    ScriptSpeed {
        /// Index of the entry that the motion ends at, from 0.
        entry: usize,
        /// Peak speed of the motion \[m/s\].
        speed: f64,
        /// Length of the motion \[m\].
        distance: f64,
        /// Its duration \[s\].
        duration: f64,
        /// Highest speed accepted \[m/s\].
        limit: f64,
    },
}

/// `Err` unless `value` is finite and at least 0.
pub(crate) fn non_negative(what: &'static str, value: f64) -> Result<(), SetupError> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(SetupError::OutOfRange { what, value, range: "finite and at least 0" })
    }
}

/// `Err` unless `value` is finite and above 0.
pub(crate) fn positive(what: &'static str, value: f64) -> Result<(), SetupError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(SetupError::OutOfRange { what, value, range: "finite and above 0" })
    }
}
