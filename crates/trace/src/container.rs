//! The file around the messages: chunks, counts, and how much of it is whole.

use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use foxglove::Encode;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Compression, McapError, McapResult, WriteOptions};

use crate::config::TraceConfig;
use crate::error::TraceError;
use crate::record::Record;
use crate::sink::{CountingSink, TraceSink};
use crate::topic::Topic;

/// Uncompressed size at which a chunk is closed (bytes).
const CHUNK_SIZE: u64 = 1 << 20;

/// What a writer has put into its sink.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WriteReport {
    /// Length of what is whole and readable (bytes).
    pub bytes: u64,
    /// Messages in it by topic; topics without a message are left out.
    pub messages: Vec<(Topic, u64)>,
    /// Messages that were taken but are not in it, since writing failed.
    pub cut: u64,
}

/// An MCAP file that is being written. Chunks are built in memory and handed over whole.
pub(crate) struct Container<S: TraceSink> {
    mcap: mcap::Writer<NoSeek<CountingSink<S>>>,
    channels: [u16; Topic::ALL.len()],
    counts: [u64; Topic::ALL.len()],
    /// Bytes handed to the sink so far, whole or not.
    handed_over: Arc<AtomicU64>,
    /// Length of what is whole, and the messages in it.
    whole: u64,
    whole_counts: [u64; Topic::ALL.len()],
    start_unix_ns: u64,
    flush_period_ns: u64,
    next_flush_ns: u64,
    message: Vec<u8>,
}

impl<S: TraceSink> Container<S> {
    /// Opens the file; nothing but its head is in it.
    pub(crate) fn new(sink: S, config: &TraceConfig) -> Result<Self, TraceError> {
        let (sink, handed_over) = CountingSink::new(sink);
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(CHUNK_SIZE))
            .library(concat!("palpate ", env!("CARGO_PKG_VERSION")))
            .disable_seeking(true);
        let mcap = options.create(NoSeek::new(sink)).map_err(|source| write_error(0, source))?;
        Ok(Self {
            mcap,
            channels: [0; Topic::ALL.len()],
            counts: [0; Topic::ALL.len()],
            handed_over,
            whole: 0,
            whole_counts: [0; Topic::ALL.len()],
            start_unix_ns: config.start_unix_ns,
            flush_period_ns: config.flush_period_ns,
            next_flush_ns: config.flush_period_ns,
            message: Vec::new(),
        })
    }

    /// Metadata, attachments and one channel per topic.
    pub(crate) fn describe(&mut self, config: &TraceConfig) -> McapResult<()> {
        let mut engine = config.engine.clone();
        engine.insert("start_unix_ns".into(), config.start_unix_ns.to_string());
        self.mcap.write_metadata(&Metadata { name: "engine".into(), metadata: engine })?;
        for attachment in &config.attachments {
            self.mcap.attach(&mcap::Attachment {
                log_time: config.start_unix_ns,
                create_time: config.start_unix_ns,
                name: attachment.name.clone(),
                media_type: attachment.media_type.clone(),
                data: attachment.data.as_slice().into(),
            })?;
        }
        for topic in Topic::ALL {
            let schema = topic.schema();
            let id = self.mcap.add_schema(&schema.name, "protobuf", &schema.data)?;
            self.channels[topic as usize] =
                self.mcap.add_channel(id, topic.name(), "protobuf", &schema.channel_metadata)?;
        }
        Ok(())
    }

    pub(crate) fn put_record<R: Record>(&mut self, topic: Topic, time_ns: u64, record: &R) -> McapResult<()> {
        self.message.clear();
        record.encode(&mut self.message);
        self.put_message(topic, time_ns)
    }

    pub(crate) fn put_foxglove<M: Encode>(&mut self, topic: Topic, time_ns: u64, message: &M) -> McapResult<()> {
        self.message.clear();
        message.encode(&mut self.message).map_err(|error| McapError::Io(io::Error::other(error.to_string())))?;
        self.put_message(topic, time_ns)
    }

    /// Puts `self.message`. The time of the records, not the clock, decides when to flush: equal records then give
    /// equal chunks.
    fn put_message(&mut self, topic: Topic, time_ns: u64) -> McapResult<()> {
        if time_ns >= self.next_flush_ns {
            self.flush()?;
            self.next_flush_ns = time_ns.saturating_add(self.flush_period_ns);
        }
        let before = self.bytes();
        let log_time = self.unix_ns(time_ns);
        let header = MessageHeader {
            channel_id: self.channels[topic as usize],
            sequence: self.counts[topic as usize] as u32,
            log_time,
            publish_time: log_time,
        };
        self.mcap.write_to_known_channel(&header, &self.message)?;
        if self.bytes() != before {
            // The chunk before this message was full and has been handed over; the message itself waits in the next.
            self.mark_whole();
        }
        self.counts[topic as usize] += 1;
        Ok(())
    }

    pub(crate) fn put_metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> McapResult<()> {
        self.mcap.write_metadata(&Metadata { name: name.into(), metadata: entries })?;
        self.mark_whole();
        Ok(())
    }

    /// Closes the chunk and hands it to the system.
    pub(crate) fn flush(&mut self) -> McapResult<()> {
        self.mcap.flush()?;
        self.mark_whole();
        Ok(())
    }

    /// Bytes handed to the sink so far.
    pub(crate) fn bytes(&self) -> u64 {
        self.handed_over.load(Ordering::Relaxed)
    }

    pub(crate) fn unix_ns(&self, time_ns: u64) -> u64 {
        self.start_unix_ns.saturating_add(time_ns)
    }

    /// An error of the file as one of the trace, with the length that remains readable.
    pub(crate) fn checked<T>(&self, result: McapResult<T>) -> Result<T, TraceError> {
        result.map_err(|source| write_error(self.whole, source))
    }

    /// Writes indexes and statistics and closes the file, or cuts it back to what is whole and closes it there.
    pub(crate) fn finish(mut self) -> (S, WriteReport, Option<TraceError>) {
        let finished = self.mcap.finish();
        let finished = self.checked(finished);
        if finished.is_ok() {
            self.mark_whole();
        }
        let whole = self.whole;
        let mut report = self.report();
        let mut sink = self.mcap.into_inner().into_inner().inner;
        let failure = finished.err().or_else(|| sink.flush().err().map(|source| write_error(whole, source.into())));
        if failure.is_some() && seal(&mut sink, whole).is_ok() {
            report.bytes += END.len() as u64;
        }
        (sink, report, failure)
    }

    fn mark_whole(&mut self) {
        self.whole = self.bytes();
        self.whole_counts = self.counts;
    }

    fn report(&self) -> WriteReport {
        let counts = Topic::ALL.into_iter().zip(self.whole_counts);
        let (taken, kept): (u64, u64) = (self.counts.iter().sum(), self.whole_counts.iter().sum());
        WriteReport { bytes: self.whole, messages: counts.filter(|(_, n)| *n > 0).collect(), cut: taken - kept }
    }
}

fn write_error(kept: u64, source: McapError) -> TraceError {
    TraceError::Write { kept, source }
}

/// Cuts `sink` to `whole` bytes and closes the file there.
fn seal<S: TraceSink>(sink: &mut S, whole: u64) -> io::Result<()> {
    sink.truncate(whole)?;
    sink.write_all(&END)?;
    sink.flush()
}

/// A data end and a footer without checksums or summary, and the magic: the shortest end of an MCAP file.
const END: [u8; 50] = {
    let mut end = [0; 50];
    end[0] = 0x0f; // data end: 4 bytes, checksum unknown
    end[1] = 4;
    end[13] = 0x02; // footer: 20 bytes, no summary
    end[14] = 20;
    let mut k = 0;
    while k < mcap::MAGIC.len() {
        end[42 + k] = mcap::MAGIC[k];
        k += 1;
    }
    end
};
