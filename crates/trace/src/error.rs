//! Errors of set-up, of writing and of reading.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::wire::WireError;

/// What can go wrong with a trace.
#[derive(Debug, Error)]
pub enum TraceError {
    /// The file could not be created.
    #[error("cannot create the trace {}: {source}; name a writable file in an existing folder, or run without a trace", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system answered.
        source: io::Error,
    },
    /// A value of the configuration makes no sense.
    #[error("trace: {what} is {value}; {remedy}")]
    Config {
        /// The value's name.
        what: String,
        /// The value.
        value: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The system refused to start the thread.
    #[error("cannot start the trace thread: {0}")]
    Thread(io::Error),
    /// Writing failed; the simulation goes on without a trace.
    #[error(
        "writing the trace failed after {kept} bytes: {}; these bytes are kept, later records are lost",
        cause(source)
    )]
    Write {
        /// Length of the part of the file that is whole (bytes).
        kept: u64,
        /// What failed.
        source: mcap::McapError,
    },
    /// The trace thread panicked.
    #[error("the trace thread ended early; the trace may be cut short")]
    Panicked,
    /// The file could not be opened or read.
    #[error("cannot read the trace {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system answered.
        source: io::Error,
    },
    /// The file is something else.
    #[error("{}: not a trace: {}; name an MCAP file that `palpate run` wrote", path.display(), if *empty { "it is empty" } else { "it does not begin as MCAP does" })]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Whether there is nothing in it.
        empty: bool,
    },
    /// The file is not a whole MCAP file.
    #[error("{}: damaged within its first {offset} bytes: {}", path.display(), cause(source))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The damage lies before this offset (bytes).
        offset: u64,
        /// What was found.
        source: mcap::McapError,
    },
    /// Parts of the file are damaged; what lies between and behind them was read.
    #[error(
        "{}: {}: {}{}",
        path.display(),
        all(parts),
        cause(source),
        end.as_deref().map(|end| format!("; {end}")).unwrap_or_default()
    )]
    Parts {
        /// The file.
        path: PathBuf,
        /// The parts that are lost, in the order of the file.
        parts: Vec<LostPart>,
        /// What was found in the first.
        source: mcap::McapError,
        /// What ended the reading behind them, where it was not the end of the file.
        end: Option<Box<TraceError>>,
    },
    /// What the channels hold was told in a damaged part alone.
    #[error(
        "{}: the damaged part told what the messages behind it are, and the file has no whole end that tells it again: they \
         cannot be read",
        path.display()
    )]
    Undescribed {
        /// The file.
        path: PathBuf,
    },
    /// A message does not hold what its schema says.
    #[error("{}: message {sequence} of {topic}: {source}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// Topic of the message.
        topic: String,
        /// Its number within the topic, from 0.
        sequence: u32,
        /// What was found.
        source: WireError,
    },
}

/// A part of a trace whose messages are lost: one chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LostPart {
    /// Where it begins in the file (bytes).
    pub offset: u64,
    /// Its length in the file (bytes).
    pub length: u64,
    /// Times of its first and last message since the start of the run (ns), where they can be told.
    pub time_ns: Option<[u64; 2]>,
}

/// Parts in words: where they lie, and the time that is lost with each.
fn all(parts: &[LostPart]) -> String {
    let one = |part: &LostPart| {
        let place = format!("the {} bytes from byte {} on", part.length, part.offset);
        let time = part.time_ns.map(|times| times.map(|ns| ns as f64 * 1e-9));
        time.map_or(place.clone(), |[from, to]| format!("{place}, from {from:.3} s to {to:.3} s"))
    };
    let are = if parts.len() == 1 { "are" } else { "are all" };
    format!("{} {are} damaged and lost", parts.iter().map(one).collect::<Vec<_>>().join("; "))
}

/// The system's own words where there are some: `McapError::Io` hides them behind a general sentence.
fn cause(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(source) => source.to_string(),
        other => other.to_string(),
    }
}
