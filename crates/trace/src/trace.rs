//! A whole trace in memory.

use std::collections::BTreeMap;
use std::path::Path;

use crate::config::Attachment;
use crate::error::TraceError;
use crate::reader::{TraceEvent, TraceReader};
use crate::record::{FactorRecord, LogRecord, RigidRecord, StepRecord, TickRecord};

/// A whole trace in memory, without its geometry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Ticks in order.
    pub ticks: Vec<TickRecord>,
    /// Steps in order.
    pub steps: Vec<StepRecord>,
    /// Rigid bodies, by step and body.
    pub rigid: Vec<RigidRecord>,
    /// Factorisations in order.
    pub factors: Vec<FactorRecord>,
    /// The log in order.
    pub log: Vec<LogRecord>,
    /// Metadata records by name.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Files carried inside.
    pub attachments: Vec<Attachment>,
    /// Number of messages of other topics, by topic.
    pub others: BTreeMap<String, u64>,
}

impl Trace {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`TraceError::Read`], [`TraceError::Damaged`] (also for a file that ends early), [`TraceError::Message`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, TraceError> {
        match Self::recover(path)? {
            (trace, None) => Ok(trace),
            (_, Some(damage)) => Err(damage),
        }
    }

    /// Reads what can be read, and the damage: everything but the chunks that are damaged, where the file's records can
    /// be told apart, else everything before.
    ///
    /// # Errors
    /// [`TraceError::Read`] when the file cannot be opened.
    pub fn recover(path: impl AsRef<Path>) -> Result<(Self, Option<TraceError>), TraceError> {
        Ok(Self::collect(TraceReader::open(path)?))
    }

    /// Gathers the events of a reader up to its end. Of several damaged parts one error tells.
    pub fn collect(events: impl IntoIterator<Item = Result<TraceEvent, TraceError>>) -> (Self, Option<TraceError>) {
        let (mut trace, mut damage) = (Self::default(), None);
        for event in events {
            match (event, &mut damage) {
                (Ok(event), _) => trace.push(event),
                (Err(TraceError::Parts { parts: more, .. }), Some(TraceError::Parts { parts, .. })) => {
                    parts.extend(more)
                }
                (Err(error), Some(TraceError::Parts { end, .. })) => *end = Some(Box::new(error)),
                (Err(error), _) => damage = Some(error),
            }
        }
        (trace, damage)
    }

    fn push(&mut self, event: TraceEvent) {
        match event {
            TraceEvent::Tick(record) => self.ticks.push(*record),
            TraceEvent::Step(record) => self.steps.push(*record),
            TraceEvent::Rigid(record) => self.rigid.push(*record),
            TraceEvent::Factor(record) => self.factors.push(record),
            TraceEvent::Log(record) => self.log.push(*record),
            TraceEvent::Metadata { name, entries } => {
                self.metadata.insert(name, entries);
            }
            TraceEvent::Attachment(attachment) => self.attachments.push(attachment),
            TraceEvent::Other { topic, .. } => *self.others.entry(topic).or_default() += 1,
        }
    }

    /// The attached file of that name.
    pub fn attachment(&self, name: &str) -> Option<&[u8]> {
        self.attachments.iter().find(|attachment| attachment.name == name).map(|attachment| &*attachment.data)
    }
}
