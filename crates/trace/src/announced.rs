//! The channels that the end of a file names again, for one whose beginning is damaged.

use std::io::{Read, Seek};

use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};

/// A channel that a file has.
pub(crate) struct Announced {
    pub(crate) id: u16,
    pub(crate) topic: String,
    /// Name of its schema.
    pub(crate) schema: Option<String>,
}

/// The channels of a file of `length` bytes by its summary: none of a file that has no end, or a damaged one. No record of it
/// may be longer than `limit` (bytes).
pub(crate) fn channels(file: &mut (impl Read + Seek), length: u64, limit: usize) -> Vec<Announced> {
    let options = SummaryReaderOptions::default().with_file_size(length).with_record_length_limit(limit);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        let answered = event.map_err(drop).and_then(|event| match event {
            SummaryReadEvent::ReadRequest(wanted) => {
                file.read(reader.insert(wanted)).map(|read| reader.notify_read(read)).map_err(drop)
            }
            SummaryReadEvent::SeekRequest(to) => file.seek(to).map(|place| reader.notify_seeked(place)).map_err(drop),
        });
        if answered.is_err() {
            return Vec::new();
        }
    }
    let channels = reader.finish().map(|summary| summary.channels).unwrap_or_default();
    let announced = channels.into_values().map(|channel| Announced {
        id: channel.id,
        topic: channel.topic.clone(),
        schema: channel.schema.as_ref().map(|schema| schema.name.clone()),
    });
    announced.collect()
}
