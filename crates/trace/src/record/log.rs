//! A line of the log, with its text inline so that it can cross a ring without allocation.

use std::fmt;

use crate::wire::{Value, WireError, fields};

/// Severity, as in `foxglove.Log`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// Not stated.
    #[default]
    Unknown,
    /// For whoever looks for a fault.
    Debug,
    /// A state that a user may want to know.
    Info,
    /// Something degraded; the run goes on as asked.
    Warning,
    /// Something failed; the run goes on without it.
    Error,
    /// The run ends.
    Fatal,
}

impl LogLevel {
    fn from_number(number: u64) -> Self {
        match number {
            1 => Self::Debug,
            2 => Self::Info,
            3 => Self::Warning,
            4 => Self::Error,
            5 => Self::Fatal,
            _ => Self::Unknown,
        }
    }
}

/// Text of at most `N` bytes; longer text is cut at a character and ends in `…`.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Text<const N: usize> {
    bytes: [u8; N],
    length: u16,
}

const ELLIPSIS: &str = "…";

impl<const N: usize> Text<N> {
    fn new(text: &str) -> Self {
        let mut bytes = [0; N];
        let mut length = text.len();
        if length > N {
            length = text.floor_char_boundary(N - ELLIPSIS.len());
            bytes[length..length + ELLIPSIS.len()].copy_from_slice(ELLIPSIS.as_bytes());
            bytes[..length].copy_from_slice(&text.as_bytes()[..length]);
            length += ELLIPSIS.len();
        } else {
            bytes[..length].copy_from_slice(text.as_bytes());
        }
        Self { bytes, length: length as u16 }
    }

    fn as_str(&self) -> &str {
        // Built from a str and cut at a character, so this always holds.
        std::str::from_utf8(self.bytes.get(..usize::from(self.length)).unwrap_or_default()).unwrap_or_default()
    }
}

/// One line of the log.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct LogRecord {
    /// Time since the start of the run (ns).
    pub time_ns: u64,
    /// Severity.
    pub level: LogLevel,
    source: Text<30>,
    message: Text<470>,
}

impl LogRecord {
    /// A line from `source` (at most 30 bytes) that says `message` (at most 470 bytes); longer text is cut and ends
    /// in `…`. Allocates nothing.
    pub fn new(time_ns: u64, level: LogLevel, source: &str, message: &str) -> Self {
        Self { time_ns, level, source: Text::new(source), message: Text::new(message) }
    }

    /// Who speaks: a stage, a body, a device.
    pub fn source(&self) -> &str {
        self.source.as_str()
    }

    /// What is said.
    pub fn message(&self) -> &str {
        self.message.as_str()
    }

    /// Reads a `foxglove.Log`; its time comes from the MCAP record.
    pub(crate) fn decode(message: &[u8], time_ns: u64) -> Result<Self, WireError> {
        let mut record = Self::new(time_ns, LogLevel::Unknown, "", "");
        for field in fields(message) {
            let (field, value) = field?;
            let invalid = WireError::FieldType { message: "foxglove.Log", field };
            let text = |value| match value {
                Value::Bytes(bytes) => std::str::from_utf8(bytes).map_err(|_| invalid),
                _ => Err(invalid),
            };
            match field {
                2 => match value {
                    Value::Varint(number) => record.level = LogLevel::from_number(number),
                    _ => return Err(invalid),
                },
                3 => record.message = Text::new(text(value)?),
                4 => record.source = Text::new(text(value)?),
                _ => {}
            }
        }
        Ok(record)
    }
}

impl fmt::Debug for LogRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LogRecord")
            .field("time_ns", &self.time_ns)
            .field("level", &self.level)
            .field("source", &self.source())
            .field("message", &self.message())
            .finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_text_is_cut_at_a_character() {
        for length in 465..480 {
            let text = "µ".repeat(length);
            let record = LogRecord::new(0, LogLevel::Info, "step", &text);
            assert!(record.message().len() <= 470);
            let kept = record.message().trim_end_matches(ELLIPSIS);
            assert!(text.starts_with(kept) && kept.len() >= 466, "{} bytes kept", kept.len());
        }
        let short = LogRecord::new(0, LogLevel::Info, "step", &"x".repeat(470));
        assert_eq!(short.message().len(), 470);
        assert!(!short.message().ends_with(ELLIPSIS));
    }
}
