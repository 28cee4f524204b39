//! The trace thread: ordinary priority, wakes now and then, never woken by a producer.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::config::TraceConfig;
use crate::drain::{Drain, Progress};
use crate::error::TraceError;
use crate::metadata::MetadataTrace;
use crate::record::LogRecord;
use crate::ring::{DropCounters, FactorTrace, LogTrace, StepTrace, TickTrace};
use crate::summary::{TraceStatus, TraceSummary};
use crate::writer::create_file;

/// Sleep when the rings are empty: a wake-up by the producers would cost them a system call.
const NAP: Duration = Duration::from_millis(10);

/// A trace written by a thread of its own. Dropping it finishes the file too.
#[derive(Debug)]
pub struct TraceThread {
    thread: Option<JoinHandle<TraceSummary>>,
    stop: Arc<AtomicBool>,
    progress: Arc<Progress>,
    dropped: Arc<DropCounters>,
    log: LogTrace,
    path: PathBuf,
}

impl TraceThread {
    /// Creates the file at `path`, replacing what was there, and starts the thread. The thread inherits the
    /// scheduling of the caller, so call it from one of ordinary priority.
    ///
    /// # Errors
    /// [`TraceError::Create`] for a bad path, [`TraceError::Config`], [`TraceError::Thread`]. A disk that is full,
    /// now or later, is no error here: see [`TraceThread::take_failure`].
    pub fn spawn(
        path: impl AsRef<Path>,
        config: &TraceConfig,
    ) -> Result<(Self, TickTrace, StepTrace, FactorTrace), TraceError> {
        let path = path.as_ref();
        config.validate()?;
        let (drain, producers) = Drain::new(create_file(path)?, path, config)?;
        let (progress, dropped) = (drain.progress(), drain.drop_counters());
        let stop = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&stop);
        let thread = thread::Builder::new()
            .name("palpate-trace".into())
            .spawn(move || run(drain, &seen))
            .map_err(TraceError::Thread)?;
        let trace = Self { thread: Some(thread), stop, progress, dropped, log: producers.log, path: path.into() };
        Ok((trace, producers.tick, producers.step, producers.factor))
    }

    /// Hands over a line of the log; `false` when it was dropped and counted.
    pub fn log(&mut self, record: LogRecord) -> bool {
        self.log.push(record)
    }

    /// Entries of the metadata record `end`, which is written when the file is closed.
    pub fn set_end(&mut self, entries: BTreeMap<String, String>) {
        self.progress.set_end(entries);
    }

    /// Where metadata is handed over while threads run.
    pub fn metadata(&self) -> MetadataTrace {
        MetadataTrace(Arc::clone(&self.progress))
    }

    /// How the trace stands.
    pub fn status(&self) -> TraceStatus {
        self.progress.status(&self.dropped)
    }

    /// The failure, to whoever asks first; afterwards `None`.
    pub fn take_failure(&self) -> Option<Arc<TraceError>> {
        self.progress.take_failure()
    }

    /// Writes what was pushed before this call and closes the file.
    pub fn finish(mut self) -> TraceSummary {
        self.join().unwrap_or_else(|| TraceSummary {
            path: self.path.clone(),
            bytes: self.status().bytes,
            messages: Vec::new(),
            dropped: self.dropped.read(),
            lost: self.status().lost,
            failure: Some(Arc::new(TraceError::Panicked)),
        })
    }

    /// `None` when the thread panicked or was joined before.
    fn join(&mut self) -> Option<TraceSummary> {
        self.stop.store(true, Ordering::Release);
        let thread = self.thread.take()?;
        thread.thread().unpark();
        thread.join().ok()
    }
}

impl Drop for TraceThread {
    fn drop(&mut self) {
        let _ = self.join();
    }
}

fn run(mut drain: Drain<std::fs::File>, stop: &AtomicBool) -> TraceSummary {
    // The flag is read before the rings, so that what was pushed before it was set is seen.
    while !stop.load(Ordering::Acquire) {
        if !drain.drain() {
            thread::park_timeout(NAP);
        }
    }
    drain.finish().1
}
