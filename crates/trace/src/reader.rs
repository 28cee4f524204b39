//! From a trace back to its records.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{Record as McapRecord, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::announced::channels;
use crate::chunk::{times, unpack};
use crate::config::Attachment;
use crate::error::{LostPart, TraceError};
use crate::record::{FactorRecord, LogRecord, Record, RigidRecord, StepRecord, TickRecord};
use crate::wire::WireError;

/// Bytes of a record of the file before its data: what it is, and its length.
const RECORD_HEAD: u64 = 9;

/// Bytes asked of the system at a time.
const READ_SIZE: usize = 64 << 10;

/// What a trace holds, in the order of the file: by time within a topic.
#[derive(Clone, Debug, PartialEq)]
pub enum TraceEvent {
    /// A tick.
    Tick(Box<TickRecord>),
    /// A step.
    Step(Box<StepRecord>),
    /// A rigid body after a step.
    Rigid(Box<RigidRecord>),
    /// A factorisation.
    Factor(FactorRecord),
    /// A line of the log.
    Log(Box<LogRecord>),
    /// A metadata record.
    Metadata {
        /// Its name: `engine` or `dropped`.
        name: String,
        /// Its entries.
        entries: BTreeMap<String, String>,
    },
    /// A file carried inside the trace.
    Attachment(Attachment),
    /// A message of another schema: geometry, poses, or a topic of somebody else.
    Other {
        /// Its topic.
        topic: String,
        /// Time since the start of the run (ns).
        time_ns: u64,
    },
}

/// Which record a channel carries, by its schema.
#[derive(Clone, Copy)]
enum Content {
    Tick,
    Step,
    Rigid,
    Factor,
    Log,
    Other,
}

struct ReadChannel {
    topic: String,
    content: Content,
    messages: u32,
}

/// Reads a trace from start to end in bounded memory, checking every checksum. A chunk that is damaged is an error
/// ([`TraceError::Parts`]), after which it goes on behind it; it ends after any other error.
pub struct TraceReader<R = File> {
    source: R,
    mcap: LinearReader,
    path: PathBuf,
    /// Bytes read so far.
    offset: u64,
    /// Where the next record of the file begins.
    place: u64,
    /// What the last chunk held.
    events: VecDeque<Result<TraceEvent, EventError>>,
    /// A chunk was damaged.
    lossy: bool,
    /// The file once more, for what its end tells.
    file: Option<File>,
    length: u64,
    limit: usize,
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, ReadChannel>,
    start_unix_ns: u64,
    /// A record was read: the file is MCAP.
    begun: bool,
    ended: bool,
}

impl TraceReader {
    /// Opens the file at `path`.
    ///
    /// # Errors
    /// [`TraceError::Read`]
    pub fn open(path: impl AsRef<Path>) -> Result<Self, TraceError> {
        let path = path.as_ref();
        let opened = File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
        let (length, file) = opened.map_err(|source| TraceError::Read { path: path.into(), source })?;
        Ok(Self { file: File::open(path).ok(), ..Self::new(file, length, path) })
    }
}

impl<R: Read> TraceReader<R> {
    /// Reads from `source`, which holds `length` bytes; `path` is its name in errors.
    pub fn new(source: R, length: u64, path: impl AsRef<Path>) -> Self {
        let limit = length_limit(length);
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(limit);
        Self {
            source,
            mcap: LinearReader::new_with_options(options),
            path: path.as_ref().into(),
            offset: 0,
            place: mcap::MAGIC.len() as u64,
            events: VecDeque::new(),
            lossy: false,
            file: None,
            length,
            limit,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            start_unix_ns: 0,
            begun: false,
            ended: false,
        }
    }

    fn advance(&mut self) -> Result<Option<TraceEvent>, TraceError> {
        loop {
            if let Some(event) = self.events.pop_front() {
                return event.map(Some).map_err(|error| self.told(error));
            }
            let begun = self.begun;
            let damaged = |source| match (self.offset, source) {
                (0, _) => TraceError::Foreign { path: self.path.clone(), empty: true },
                (_, McapError::BadMagic) if !begun => TraceError::Foreign { path: self.path.clone(), empty: false },
                (offset, source) => TraceError::Damaged { path: self.path.clone(), offset, source },
            };
            let wanted = match self.mcap.next_event() {
                None => return Ok(None),
                // The checksum of all bytes, which cannot hold where some are known to be damaged.
                Some(Err(McapError::BadDataCrc { .. })) if self.lossy => return Ok(None),
                Some(Err(error)) => return Err(damaged(error)),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => wanted.max(READ_SIZE),
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    self.begun = true;
                    let (offset, length) = (self.place, RECORD_HEAD + data.len() as u64);
                    self.place += length;
                    let tables = &mut Tables {
                        schemas: &mut self.schemas,
                        channels: &mut self.channels,
                        start_unix_ns: &mut self.start_unix_ns,
                    };
                    if opcode == op::CHUNK {
                        let Err(source) = unpack(data, self.limit, |record| {
                            event(record, tables)
                                .transpose()
                                .into_iter()
                                .for_each(|event| self.events.push_back(event));
                        }) else {
                            continue;
                        };
                        self.events.clear();
                        self.lossy = true;
                        // The first chunk alone tells what the channels hold, but for the summary.
                        if let Some(mut file) = self.file.take() {
                            for known in channels(&mut file, self.length, self.limit) {
                                let content = content(known.schema.as_ref());
                                let new = ReadChannel { topic: known.topic, content, messages: 0 };
                                tables.channels.entry(known.id).or_insert(new);
                            }
                        }
                        let part = LostPart { offset, length, time_ns: times(data, *tables.start_unix_ns) };
                        return Err(TraceError::Parts {
                            path: self.path.clone(),
                            parts: vec![part],
                            source,
                            end: None,
                        });
                    }
                    let record = mcap::parse_record(opcode, data).map_err(damaged)?;
                    match event(record, tables).transpose() {
                        Some(event) => return event.map(Some).map_err(|error| self.told(error)),
                        None => continue,
                    }
                }
            };
            let read = self.source.read(self.mcap.insert(wanted));
            let read = read.map_err(|source| TraceError::Read { path: self.path.clone(), source })?;
            self.mcap.notify_read(read);
            self.offset += read as u64;
        }
    }

    fn told(&self, error: EventError) -> TraceError {
        let path = self.path.clone();
        match error {
            EventError::Mcap(McapError::UnknownChannel(..)) if self.lossy => TraceError::Undescribed { path },
            EventError::Mcap(source) => TraceError::Damaged { path, offset: self.offset, source },
            EventError::Message { topic, sequence, source } => TraceError::Message { path, topic, sequence, source },
        }
    }
}

impl<R: Read> Iterator for TraceReader<R> {
    type Item = Result<TraceEvent, TraceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let event = self.advance().transpose();
        self.ended = !matches!(event, Some(Ok(_) | Err(TraceError::Parts { .. })));
        event
    }
}

/// Longest record that is believed (bytes): a wrong length must not make us ask for all memory. Chunks of positions
/// compress by far less than 16.
fn length_limit(file: u64) -> usize {
    const SMALLEST: u64 = 16 << 20;
    const LARGEST: u64 = 1 << 30;
    file.saturating_mul(16).clamp(SMALLEST, LARGEST) as usize
}

/// What the records of a file have told so far.
struct Tables<'a> {
    schemas: &'a mut HashMap<u16, String>,
    channels: &'a mut HashMap<u16, ReadChannel>,
    start_unix_ns: &'a mut u64,
}

enum EventError {
    Mcap(McapError),
    Message { topic: String, sequence: u32, source: WireError },
}

/// The event that a record is, or `None` for one that only serves reading.
fn event(record: McapRecord<'_>, tables: &mut Tables<'_>) -> Result<Option<TraceEvent>, EventError> {
    Ok(Some(match record {
        McapRecord::Schema { header, .. } => {
            tables.schemas.insert(header.id, header.name);
            return Ok(None);
        }
        McapRecord::Channel(channel) => {
            let content = content(tables.schemas.get(&channel.schema_id));
            let new = ReadChannel { topic: channel.topic, content, messages: 0 };
            // The summary repeats every channel; its count goes on.
            tables.channels.entry(channel.id).or_insert(new);
            return Ok(None);
        }
        McapRecord::Message { header, data } => {
            let unknown = || EventError::Mcap(McapError::UnknownChannel(header.sequence, header.channel_id));
            let channel = tables.channels.get_mut(&header.channel_id).ok_or_else(unknown)?;
            let sequence = channel.messages;
            channel.messages = channel.messages.wrapping_add(1);
            let time_ns = header.log_time.saturating_sub(*tables.start_unix_ns);
            let decoded = match channel.content {
                Content::Tick => TickRecord::decode(&data).map(|record| TraceEvent::Tick(Box::new(record))),
                Content::Step => StepRecord::decode(&data).map(|record| TraceEvent::Step(Box::new(record))),
                Content::Rigid => RigidRecord::decode(&data).map(|record| TraceEvent::Rigid(Box::new(record))),
                Content::Factor => FactorRecord::decode(&data).map(TraceEvent::Factor),
                Content::Log => LogRecord::decode(&data, time_ns).map(|record| TraceEvent::Log(Box::new(record))),
                Content::Other => Ok(TraceEvent::Other { topic: channel.topic.clone(), time_ns }),
            };
            decoded.map_err(|source| EventError::Message { topic: channel.topic.clone(), sequence, source })?
        }
        McapRecord::Metadata(metadata) => {
            let start = metadata.metadata.get("start_unix_ns").and_then(|text| text.parse().ok());
            if let (Some(start), "engine") = (start, metadata.name.as_str()) {
                *tables.start_unix_ns = start;
            }
            TraceEvent::Metadata { name: metadata.name, entries: metadata.metadata }
        }
        McapRecord::Attachment { header, data, .. } => TraceEvent::Attachment(Attachment {
            name: header.name,
            media_type: header.media_type,
            data: data.into_owned(),
        }),
        _ => return Ok(None),
    }))
}

fn content(schema: Option<&String>) -> Content {
    match schema.and_then(|name| name.split_once('.')) {
        Some(("palpate", name)) if name == TickRecord::MESSAGE.name => Content::Tick,
        Some(("palpate", name)) if name == StepRecord::MESSAGE.name => Content::Step,
        Some(("palpate", name)) if name == RigidRecord::MESSAGE.name => Content::Rigid,
        Some(("palpate", name)) if name == FactorRecord::MESSAGE.name => Content::Factor,
        Some(("foxglove", "Log")) => Content::Log,
        _ => Content::Other,
    }
}
