//! From the rings into the file, by whoever calls.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::config::TraceConfig;
use crate::error::TraceError;
use crate::metadata::MetadataTrace;
use crate::record::LogRecord;
use crate::ring::{DropCounters, FactorTrace, LogTrace, Producers, Rings, StepTrace, TickTrace, rings};
use crate::sink::TraceSink;
use crate::summary::{TraceStatus, TraceSummary};
use crate::writer::{TraceWriter, create_file};

/// What the owner of a trace may look at while another thread writes it.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    bytes: AtomicU64,
    lost: AtomicU64,
    failed: AtomicBool,
    /// The failure until somebody has taken it. Only the trace and its owner lock this, never a producer.
    unreported: Mutex<Option<Arc<TraceError>>>,
    /// What the metadata record `end` will say. Only the trace and its owner lock this, never a producer.
    end: Mutex<BTreeMap<String, String>>,
    /// Metadata records that are to be written, by name. Only the trace and whoever asks for them lock this.
    metadata: Mutex<Vec<(String, BTreeMap<String, String>)>>,
}

impl Progress {
    pub(crate) fn status(&self, dropped: &DropCounters) -> TraceStatus {
        TraceStatus {
            bytes: self.bytes.load(Ordering::Relaxed),
            dropped: dropped.read(),
            lost: self.lost.load(Ordering::Relaxed),
            failed: self.failed.load(Ordering::Relaxed),
        }
    }

    pub(crate) fn take_failure(&self) -> Option<Arc<TraceError>> {
        self.unreported.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    pub(crate) fn set_end(&self, entries: BTreeMap<String, String>) {
        *self.end.lock().unwrap_or_else(PoisonError::into_inner) = entries;
    }

    pub(crate) fn put_metadata(&self, name: String, entries: BTreeMap<String, String>) {
        self.metadata.lock().unwrap_or_else(PoisonError::into_inner).push((name, entries));
    }

    fn take_metadata(&self) -> Vec<(String, BTreeMap<String, String>)> {
        std::mem::take(&mut *self.metadata.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn take_end(&self) -> BTreeMap<String, String> {
        std::mem::take(&mut *self.end.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The consuming side: rings, writer, and what became of it.
pub(crate) struct Drain<S: TraceSink> {
    rings: Rings,
    writer: Option<TraceWriter<S>>,
    failure: Option<Arc<TraceError>>,
    progress: Arc<Progress>,
    path: PathBuf,
}

impl<S: TraceSink> Drain<S> {
    /// A sink that refuses its first bytes is a failure during the run, like one that refuses later: the rings still
    /// empty and count.
    pub(crate) fn new(sink: S, path: &Path, config: &TraceConfig) -> Result<(Self, Producers), TraceError> {
        let (rings, producers) = rings(config);
        let mut drain = Self { rings, writer: None, failure: None, progress: Arc::default(), path: path.to_path_buf() };
        match TraceWriter::new(sink, config) {
            Ok(writer) => {
                drain.progress.bytes.store(writer.bytes(), Ordering::Relaxed);
                drain.writer = Some(writer);
            }
            Err(error @ TraceError::Write { .. }) => drain.fail(error),
            Err(error) => return Err(error),
        }
        Ok((drain, producers))
    }

    pub(crate) fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.progress)
    }

    pub(crate) fn drop_counters(&self) -> Arc<DropCounters> {
        Arc::clone(&self.rings.dropped)
    }

    /// Writes what the rings hold, slow records first: the order is a function of what was pushed before the call.
    /// Whether there was anything.
    pub(crate) fn drain(&mut self) -> bool {
        let mut any = false;
        while let Ok(record) = self.rings.factors.pop() {
            self.write(|writer| writer.write_factor(&record));
            any = true;
        }
        any |= self.write_metadata();
        while let Ok(record) = self.rings.steps.pop() {
            // What was handed over before the step was pushed comes first.
            self.write_metadata();
            self.write(|writer| writer.write_step(&record));
            any = true;
        }
        while let Ok(record) = self.rings.rigid.pop() {
            self.write(|writer| writer.write_rigid(&record));
            any = true;
        }
        while let Ok(record) = self.rings.step_log.pop().or_else(|_| self.rings.log.pop()) {
            self.write(|writer| writer.write_log(&record));
            any = true;
        }
        while let Ok(mut frame) = self.rings.geometry.pop() {
            let skin = frame.skin.take();
            self.write(|writer| writer.write_positions(frame.time_ns, skin.as_ref(), &frame.positions));
            // There are as many places as buffers.
            let _ = self.rings.free.push(frame);
            any = true;
        }
        // No more than were waiting at the start, so that fast ticks cannot keep the rest waiting.
        for _ in 0..self.rings.ticks.slots() {
            let Ok(record) = self.rings.ticks.pop() else { break };
            self.write(|writer| writer.write_tick(&record));
            any = true;
        }
        if let Some(writer) = &self.writer {
            self.progress.bytes.store(writer.bytes(), Ordering::Relaxed);
        }
        any
    }

    /// Writes the metadata that has been handed over; whether there was any.
    fn write_metadata(&mut self) -> bool {
        let records = self.progress.take_metadata();
        let any = !records.is_empty();
        records.into_iter().for_each(|(name, entries)| self.write(|writer| writer.write_metadata(&name, entries)));
        any
    }

    fn write(&mut self, record: impl FnOnce(&mut TraceWriter<S>) -> Result<(), TraceError>) {
        let written = match &mut self.writer {
            Some(writer) if self.failure.is_none() => record(writer),
            _ => {
                self.progress.lost.fetch_add(1, Ordering::Relaxed);
                return;
            }
        };
        if let Err(error) = written {
            self.progress.lost.fetch_add(1, Ordering::Relaxed);
            self.fail(error);
        }
    }

    fn fail(&mut self, error: TraceError) {
        let error = Arc::new(error);
        self.failure.get_or_insert(Arc::clone(&error));
        *self.progress.unreported.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        self.progress.failed.store(true, Ordering::Relaxed);
    }

    /// Writes what is left, the drop counts and the end of the file.
    pub(crate) fn finish(mut self) -> (Option<S>, TraceSummary) {
        self.drain();
        let dropped = self.rings.dropped.read();
        let entries = dropped.entries().map(|(ring, count)| (ring.to_owned(), count.to_string())).into();
        let end = self.progress.take_end();
        let written = self.writer.as_mut().map(|writer| {
            writer.write_metadata("dropped", entries)?;
            if end.is_empty() { Ok(()) } else { writer.write_metadata("end", end) }
        });
        // After a failure the writer refuses this one too.
        if let (Some(Err(error)), None) = (written, &self.failure) {
            self.fail(error);
        }
        let mut summary = TraceSummary {
            path: self.path.clone(),
            bytes: 0,
            messages: Vec::new(),
            dropped,
            lost: self.progress.lost.load(Ordering::Relaxed),
            failure: None,
        };
        let sink = self.writer.take().map(|writer| {
            let (sink, report, error) = writer.finish();
            summary.bytes = report.bytes;
            summary.messages = report.messages;
            summary.lost += report.cut;
            // After an earlier failure this one only repeats it.
            if let (Some(error), None) = (error, &self.failure) {
                self.fail(error);
            }
            sink
        });
        summary.failure = self.failure.take();
        (sink, summary)
    }
}

/// A trace that its owner writes when it calls [`InlineTrace::drain`]: for lockstep, where equal runs must give equal
/// bytes, and for tests.
pub struct InlineTrace<S: TraceSink = File> {
    drain: Drain<S>,
    log: LogTrace,
}

impl InlineTrace {
    /// Creates the file at `path`, replacing what was there.
    ///
    /// # Errors
    /// [`TraceError::Create`] for a bad path, [`TraceError::Config`].
    pub fn create(path: &Path, config: &TraceConfig) -> Result<(Self, TickTrace, StepTrace, FactorTrace), TraceError> {
        config.validate()?;
        Self::open(create_file(path)?, path, config)
    }
}

impl<S: TraceSink> InlineTrace<S> {
    /// A trace into any sink.
    ///
    /// # Errors
    /// [`TraceError::Config`]
    pub fn with_sink(sink: S, config: &TraceConfig) -> Result<(Self, TickTrace, StepTrace, FactorTrace), TraceError> {
        Self::open(sink, Path::new(""), config)
    }

    fn open(
        sink: S,
        path: &Path,
        config: &TraceConfig,
    ) -> Result<(Self, TickTrace, StepTrace, FactorTrace), TraceError> {
        let (drain, producers) = Drain::new(sink, path, config)?;
        Ok((Self { drain, log: producers.log }, producers.tick, producers.step, producers.factor))
    }

    /// Writes what the rings hold. Call it every few steps, before a ring is full.
    pub fn drain(&mut self) {
        self.drain.drain();
    }

    /// Hands over a line of the log; `false` when it was dropped and counted.
    pub fn log(&mut self, record: LogRecord) -> bool {
        self.log.push(record)
    }

    /// Entries of the metadata record `end`, which is written when the file is closed.
    pub fn set_end(&mut self, entries: BTreeMap<String, String>) {
        self.drain.progress.set_end(entries);
    }

    /// Where metadata is handed over.
    pub fn metadata(&self) -> MetadataTrace {
        MetadataTrace(self.drain.progress())
    }

    /// How the trace stands.
    pub fn status(&self) -> TraceStatus {
        self.drain.progress.status(&self.drain.rings.dropped)
    }

    /// The failure, to whoever asks first; afterwards `None`.
    pub fn take_failure(&self) -> Option<Arc<TraceError>> {
        self.drain.progress.take_failure()
    }

    /// Writes what is left and closes the file.
    pub fn finish(self) -> TraceSummary {
        self.finish_into_sink().1
    }

    /// As [`InlineTrace::finish`], with the sink; `None` when it refused its first bytes.
    pub fn finish_into_sink(self) -> (Option<S>, TraceSummary) {
        self.drain.finish()
    }
}
