//! Reports of the stages on their way into the trace, and back out of it.

mod factor_line;
mod setting;
mod step_line;
mod tick_line;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use palpate_haptics::device::DeviceSpec;
use palpate_trace::{InlineTrace, LogLevel, LogRecord, MetadataTrace, TraceError, TraceThread};
use serde::Serialize;

use crate::gathering::Gathering;
use crate::run::{RunError, RunOptions};
use crate::world::World;

pub(crate) use factor_line::FactorLine;
pub(crate) use step_line::StepLine;
pub(crate) use tick_line::TickLine;

use setting::config;

/// Attachment that holds the scene.
pub(crate) const SCENE: &str = "scene.toml";

/// Mode of a run in virtual time, in the metadata of its trace.
pub(crate) const LOCKSTEP: &str = "lockstep";

/// Entry of the trace's engine record for the limits that the device stated, as TOML.
pub(crate) const DEVICE_RECORD: &str = "device_record";

/// Metadata record that says how the run ended, and its entry for the number of ticks.
pub(crate) const END: &str = "end";
pub(crate) const TICKS: &str = "ticks";

/// What became of a trace.
#[derive(Clone, Debug, Serialize)]
pub struct TraceOutcome {
    /// The file.
    pub path: PathBuf,
    /// Size (bytes).
    pub bytes: u64,
    /// Messages written.
    pub messages: u64,
    /// Records dropped because a ring was full.
    pub dropped: u64,
    /// What went wrong while it was written, if anything.
    pub error: Option<String>,
}

/// The trace itself: written by its own thread in real time, in between in lockstep, where nothing may be dropped.
pub(crate) enum TraceLines {
    Thread(TraceThread),
    Inline(Box<InlineTrace>),
}

/// What becomes of a run whose trace cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NoTrace {
    /// It goes on, and says so at its end.
    GoesOn,
    /// It does not begin.
    Refused,
}

/// The lines of the three stages and the trace that they lead to.
type Lines = (StepLine, TickLine, FactorLine, Option<TraceLines>);

impl TraceLines {
    /// Opens the trace that the options name. A file that cannot be made is noted where the run goes on without one.
    pub(crate) fn open(
        world: &World,
        options: &RunOptions,
        device: &DeviceSpec,
        no_trace: NoTrace,
        notes: &mut Vec<String>,
    ) -> Result<Lines, RunError> {
        match &options.trace {
            None => Ok(Self::none()),
            Some(path) => match Self::create(world, options, device, path) {
                Err(error @ TraceError::Create { .. }) if no_trace == NoTrace::GoesOn => {
                    notes.push(format!("{error}; the run goes on without a trace"));
                    Ok(Self::none())
                }
                lines => Ok(lines?),
            },
        }
    }

    fn none() -> Lines {
        (StepLine(None), TickLine(None), FactorLine(None), None)
    }

    fn create(world: &World, options: &RunOptions, device: &DeviceSpec, path: &Path) -> Result<Lines, TraceError> {
        let config = config(world, options, device);
        let (ticks, steps, factors, lines) = if options.lockstep {
            let (inline, ticks, steps, factors) = InlineTrace::create(path, &config)?;
            (ticks, steps, factors, Self::Inline(Box::new(inline)))
        } else {
            let (thread, ticks, steps, factors) = TraceThread::spawn(path, &config)?;
            (ticks, steps, factors, Self::Thread(thread))
        };
        Ok((StepLine(Some((steps, world.dt(), 0))), TickLine(Some(ticks)), FactorLine(Some(factors)), Some(lines)))
    }

    /// Where metadata is handed over while the run lasts.
    pub(crate) fn metadata(&self) -> MetadataTrace {
        match self {
            Self::Thread(thread) => thread.metadata(),
            Self::Inline(inline) => inline.metadata(),
        }
    }

    /// In lockstep, writes what waits in the rings.
    pub(crate) fn drain(&mut self) {
        if let Self::Inline(inline) = self {
            inline.drain();
        }
    }

    /// Writes the notes of the run and how it ended, and closes the file.
    pub(crate) fn finish(self, gathering: &Gathering) -> TraceOutcome {
        let [steps, factors, ticks] = gathering.counts();
        let end = BTreeMap::from([
            ("end".to_string(), gathering.end.name().to_string()),
            ("steps".into(), steps.to_string()),
            ("factors".into(), factors.to_string()),
            (TICKS.into(), ticks.to_string()),
        ]);
        let time_ns = nanoseconds(gathering.progress().time);
        let line = |level, text: &str| LogRecord::new(time_ns, level, "run", text);
        let notes = gathering.notes.iter().map(|note| line(LogLevel::Warning, note));
        let notes = notes.chain([line(LogLevel::Info, &format!("the run ended: {}", gathering.end))]);
        // A line that finds no room is counted with the other drops.
        let summary = match self {
            Self::Thread(mut thread) => {
                notes.for_each(|note| _ = thread.log(note));
                thread.set_end(end);
                thread.finish()
            }
            Self::Inline(mut inline) => {
                notes.for_each(|note| _ = inline.log(note));
                inline.set_end(end);
                inline.finish()
            }
        };
        TraceOutcome {
            path: summary.path,
            bytes: summary.bytes,
            messages: summary.messages.iter().map(|(_, n)| n).sum(),
            dropped: summary.dropped.total(),
            error: summary.failure.map(|e| e.to_string()),
        }
    }
}

fn nanoseconds(seconds: f64) -> u64 {
    // Saturates: negative and non-finite times become 0.
    (seconds * 1e9).round() as u64
}

fn signed_nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}
