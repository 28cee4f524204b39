//! The synchronous core: records in, MCAP out.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use foxglove::Encode;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Compression, McapError, McapResult, WriteOptions};

use crate::config::TraceConfig;
use crate::error::TraceError;
use crate::geometry::ToolHinge;
use crate::record::{FactorRecord, LogRecord, Record, RigidRecord, StepRecord, TickRecord};
use crate::ring::Skin;
use crate::scene_message::{body_shapes, frame_transforms, log, rigid_transform, tool_pose};
use crate::sink::{CountingSink, TraceSink};
use crate::tissue_message::TissueMessages;
use crate::tool_message::{hinge_of, tool_shape};
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

/// Writes records as they come. Chunks are built in memory and handed over whole, so a file that is cut at any time
/// holds every chunk before the cut.
///
/// After an error the writer refuses further records; [`TraceWriter::finish`] closes what was whole. The sink should
/// not hold back what it is given.
pub struct TraceWriter<S: TraceSink> {
    mcap: mcap::Writer<NoSeek<CountingSink<S>>>,
    channels: [u16; Topic::ALL.len()],
    counts: [u32; Topic::ALL.len()],
    /// Bytes handed to the sink so far, whole or not.
    handed_over: Arc<AtomicU64>,
    /// Length of what is whole, and the messages in it.
    whole: u64,
    whole_counts: [u32; Topic::ALL.len()],
    start_unix_ns: u64,
    /// What the tool's jaws turn about.
    hinge: Option<ToolHinge>,
    pose_stride: u64,
    /// Names of the bodies that move.
    rigid: Vec<String>,
    flush_period_ns: u64,
    next_flush_ns: u64,
    tissue: Option<TissueMessages>,
    message: Vec<u8>,
}

impl TraceWriter<std::fs::File> {
    /// Creates the file at `path`, replacing what was there.
    ///
    /// # Errors
    /// [`TraceError::Config`], [`TraceError::Create`] for a bad path, [`TraceError::Write`] for a full disk.
    pub fn create(path: &Path, config: &TraceConfig) -> Result<Self, TraceError> {
        Self::new(create_file(path)?, config)
    }
}

/// Creates the file at `path`, replacing what was there.
pub(crate) fn create_file(path: &Path) -> Result<std::fs::File, TraceError> {
    std::fs::File::create(path).map_err(|source| TraceError::Create { path: path.into(), source })
}

impl<S: TraceSink> TraceWriter<S> {
    /// Writes schemas, channels, metadata, attachments and the tool's shape to `sink`.
    ///
    /// # Errors
    /// [`TraceError::Config`] for a description that makes no sense, [`TraceError::Write`] when the sink refuses.
    pub fn new(sink: S, config: &TraceConfig) -> Result<Self, TraceError> {
        config.validate()?;
        let (sink, handed_over) = CountingSink::new(sink);
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(CHUNK_SIZE))
            .library(concat!("palpate ", env!("CARGO_PKG_VERSION")))
            .disable_seeking(true);
        let mcap = options.create(NoSeek::new(sink)).map_err(|source| write_error(0, source))?;
        let mut writer = Self {
            mcap,
            channels: [0; Topic::ALL.len()],
            counts: [0; Topic::ALL.len()],
            handed_over,
            whole: 0,
            whole_counts: [0; Topic::ALL.len()],
            start_unix_ns: config.start_unix_ns,
            pose_stride: config.pose_stride,
            hinge: hinge_of(config.tool.as_ref()),
            rigid: config.solids.iter().filter(|s| s.moves).map(|s| s.name.clone()).collect(),
            flush_period_ns: config.flush_period_ns,
            next_flush_ns: config.flush_period_ns,
            tissue: (!config.bodies.is_empty()).then(|| TissueMessages::new(&config.bodies)),
            message: Vec::new(),
        };
        let begun = writer.begin(config);
        writer.checked(begun)?;
        Ok(writer)
    }

    fn begin(&mut self, config: &TraceConfig) -> McapResult<()> {
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
        if let Some(shape) = &config.tool {
            self.write_foxglove(Topic::ToolShape, 0, &tool_shape(shape, config.start_unix_ns))?;
        }
        if !config.solids.is_empty() {
            self.write_foxglove(Topic::BodyShapes, 0, &body_shapes(&config.solids, config.start_unix_ns))?;
        }
        self.mcap.flush()?;
        self.mark_whole();
        Ok(())
    }

    /// Writes a tick, and its poses every `pose_stride` ticks.
    ///
    /// # Errors
    /// [`TraceError::Write`], as for every other method that writes.
    pub fn write_tick(&mut self, tick: &TickRecord) -> Result<(), TraceError> {
        let written = self.put_tick(tick);
        self.checked(written)
    }

    /// Writes a step.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_step(&mut self, step: &StepRecord) -> Result<(), TraceError> {
        let written = self.write_record(Topic::Step, step.time_ns, step);
        self.checked(written)
    }

    /// Writes where a rigid body is, and the frame of its shape.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_rigid(&mut self, body: &RigidRecord) -> Result<(), TraceError> {
        let written = self.put_rigid(body);
        self.checked(written)
    }

    /// Writes a factorisation.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_factor(&mut self, factor: &FactorRecord) -> Result<(), TraceError> {
        let written = self.write_record(Topic::Factor, factor.time_ns, factor);
        self.checked(written)
    }

    /// Writes a line of the log.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_log(&mut self, record: &LogRecord) -> Result<(), TraceError> {
        let message = log(record, self.unix_ns(record.time_ns));
        let written = self.write_foxglove(Topic::Log, record.time_ns, &message);
        self.checked(written)
    }

    /// Writes surface and nodes of all bodies from the positions of their nodes (m), `x, y, z` of each in the order of
    /// [`TraceConfig::bodies`]; none without bodies. `skin` is the first body's from now on, where it has changed.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_positions(&mut self, time_ns: u64, skin: Option<&Skin>, positions: &[f64]) -> Result<(), TraceError> {
        // Taken out and put back so that the messages can be lent to the writer that owns them.
        let Some(mut tissue) = self.tissue.take() else { return Ok(()) };
        skin.iter().for_each(|triangles| tissue.change_skin(triangles));
        tissue.update(positions, self.unix_ns(time_ns));
        let written = self
            .write_foxglove(Topic::TissueSurface, time_ns, &tissue.surface)
            .and_then(|()| self.write_foxglove(Topic::TissueNodes, time_ns, &tissue.nodes));
        self.tissue = Some(tissue);
        self.checked(written)
    }

    /// Writes a metadata record.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), TraceError> {
        let written = self.mcap.write_metadata(&Metadata { name: name.into(), metadata: entries });
        self.checked(written)?;
        self.mark_whole();
        Ok(())
    }

    /// Closes the chunk and hands it to the system.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn flush(&mut self) -> Result<(), TraceError> {
        let flushed = self.mcap.flush();
        self.checked(flushed)?;
        self.mark_whole();
        Ok(())
    }

    /// Bytes handed to the sink so far.
    pub fn bytes(&self) -> u64 {
        self.handed_over.load(Ordering::Relaxed)
    }

    /// Writes indexes and statistics and closes the file.
    ///
    /// Where that fails, or something failed before, the sink is cut back to the last whole chunk and closed there
    /// without indexes, and the error is handed out beside the report. Where the sink refuses even this, the chunks
    /// remain readable by recovery tools.
    pub fn finish(mut self) -> (S, WriteReport, Option<TraceError>) {
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

    fn report(&self) -> WriteReport {
        let counts = Topic::ALL.iter().zip(self.whole_counts);
        let messages = counts.filter(|(_, n)| *n > 0).map(|(topic, n)| (*topic, u64::from(n))).collect();
        let taken: u64 = self.counts.iter().map(|&n| u64::from(n)).sum();
        let kept: u64 = self.whole_counts.iter().map(|&n| u64::from(n)).sum();
        WriteReport { bytes: self.whole, messages, cut: taken - kept }
    }

    fn unix_ns(&self, time_ns: u64) -> u64 {
        self.start_unix_ns.saturating_add(time_ns)
    }

    fn put_tick(&mut self, tick: &TickRecord) -> McapResult<()> {
        self.write_record(Topic::HapticSample, tick.time_ns, tick)?;
        if tick.tick.is_multiple_of(self.pose_stride) {
            let unix_ns = self.unix_ns(tick.time_ns);
            self.write_foxglove(
                Topic::Transforms,
                tick.time_ns,
                &frame_transforms(tick, self.hinge.as_ref(), unix_ns),
            )?;
            self.write_foxglove(Topic::ToolPose, tick.time_ns, &tool_pose(tick, unix_ns))?;
        }
        Ok(())
    }

    fn put_rigid(&mut self, body: &RigidRecord) -> McapResult<()> {
        self.write_record(Topic::RigidState, body.time_ns, body)?;
        let Some(name) = self.rigid.get(body.body as usize) else { return Ok(()) };
        let message = rigid_transform(name, body, self.unix_ns(body.time_ns));
        self.write_foxglove(Topic::Transforms, body.time_ns, &message)
    }

    fn write_record<R: Record>(&mut self, topic: Topic, time_ns: u64, record: &R) -> McapResult<()> {
        self.message.clear();
        record.encode(&mut self.message);
        self.write_message(topic, time_ns)
    }

    fn write_foxglove<M: Encode>(&mut self, topic: Topic, time_ns: u64, message: &M) -> McapResult<()> {
        self.message.clear();
        message.encode(&mut self.message).map_err(|error| McapError::Io(io::Error::other(error.to_string())))?;
        self.write_message(topic, time_ns)
    }

    /// Writes `self.message`. The time of the records, not the clock, decides when to flush: equal records then give
    /// equal chunks.
    fn write_message(&mut self, topic: Topic, time_ns: u64) -> McapResult<()> {
        if time_ns >= self.next_flush_ns {
            self.mcap.flush()?;
            self.next_flush_ns = time_ns.saturating_add(self.flush_period_ns);
            self.mark_whole();
        }
        let before = self.bytes();
        let log_time = self.unix_ns(time_ns);
        let header = MessageHeader {
            channel_id: self.channels[topic as usize],
            sequence: self.counts[topic as usize],
            log_time,
            publish_time: log_time,
        };
        self.mcap.write_to_known_channel(&header, &self.message)?;
        if self.bytes() != before {
            // The chunk before this message was full and has been handed over; the message itself waits in the next.
            self.mark_whole();
        }
        self.counts[topic as usize] = self.counts[topic as usize].wrapping_add(1);
        Ok(())
    }

    fn mark_whole(&mut self) {
        self.whole = self.bytes();
        self.whole_counts = self.counts;
    }

    fn checked<T>(&self, result: McapResult<T>) -> Result<T, TraceError> {
        result.map_err(|source| write_error(self.whole, source))
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
