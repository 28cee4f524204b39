//! How a trace stands and what became of it.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use crate::error::TraceError;
use crate::topic::Topic;

/// Records that found their ring full.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Ticks.
    pub ticks: u64,
    /// Steps.
    pub steps: u64,
    /// States of rigid bodies.
    pub rigid: u64,
    /// Factorisations.
    pub factors: u64,
    /// Lines of the log.
    pub log: u64,
    /// Geometries that found no free buffer.
    pub geometry: u64,
}

impl Dropped {
    /// Sum over all rings.
    pub fn total(&self) -> u64 {
        self.entries().iter().map(|(_, count)| count).sum()
    }

    pub(crate) fn entries(&self) -> [(&'static str, u64); 6] {
        let Self { ticks, steps, rigid, factors, log, geometry } = *self;
        [
            ("ticks", ticks),
            ("steps", steps),
            ("rigid", rigid),
            ("factors", factors),
            ("log", log),
            ("geometry", geometry),
        ]
    }
}

/// How a trace stands while it is being written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceStatus {
    /// Bytes handed to the system.
    pub bytes: u64,
    /// Records that found their ring full.
    pub dropped: Dropped,
    /// Records that arrived after writing had failed.
    pub lost: u64,
    /// Whether writing has failed.
    pub failed: bool,
}

/// What became of a trace.
#[derive(Debug)]
pub struct TraceSummary {
    /// The file; empty for a sink that is none.
    pub path: PathBuf,
    /// Its length (bytes).
    pub bytes: u64,
    /// Messages in the file by topic; topics without a message are left out.
    pub messages: Vec<(Topic, u64)>,
    /// Records that found their ring full.
    pub dropped: Dropped,
    /// Records that arrived after writing had failed, or were in the part that was cut.
    pub lost: u64,
    /// Why writing failed, if it did. The file then ends at the last whole chunk.
    pub failure: Option<Arc<TraceError>>,
}

impl fmt::Display for TraceSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let messages: u64 = self.messages.iter().map(|(_, count)| count).sum();
        write!(f, "{}: {messages} messages, {:.1} MB", self.path.display(), self.bytes as f64 * 1e-6)?;
        for (ring, count) in self.dropped.entries().iter().filter(|(_, count)| *count > 0) {
            write!(f, ", {count} {ring} dropped")?;
        }
        if let Some(failure) = &self.failure {
            write!(f, "; {failure} ({} records)", self.lost)?;
        }
        Ok(())
    }
}
