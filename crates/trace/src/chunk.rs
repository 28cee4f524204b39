//! The records of a chunk, which is checked by its checksum before any of them is read.

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Shows the records of the chunk `data` to `each`: none of a chunk whose checksum is wrong. No record may be longer than
/// `limit` (bytes), nor the chunk itself.
pub(crate) fn unpack(data: &[u8], limit: usize, mut each: impl FnMut(Record<'_>)) -> Result<(), McapError> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(limit);
    let mut chunk = LinearReader::new_with_options(options);
    // As it lies in the file.
    let mut head = [op::CHUNK; 9];
    head[1..].copy_from_slice(&(data.len() as u64).to_le_bytes());
    let mut left = [&head[..], data];
    while let Some(event) = chunk.next_event() {
        match event? {
            LinearReadEvent::Record { data, opcode } => each(mcap::parse_record(opcode, data)?),
            LinearReadEvent::ReadRequest(wanted) => {
                let part = left.iter_mut().find(|part| !part.is_empty());
                let read = part.map_or(0, |part| {
                    let (now, later) = part.split_at(wanted.min(part.len()));
                    chunk.insert(now.len()).copy_from_slice(now);
                    *part = later;
                    now.len()
                });
                chunk.notify_read(read);
            }
        }
    }
    Ok(())
}

/// Times of the first and last message of the chunk `data` since the start of the run (ns), as its head says. The head is
/// under no checksum of its own: times that cannot be are none.
pub(crate) fn times(data: &[u8], start_unix_ns: u64) -> Option<[u64; 2]> {
    /// A year (ns).
    const LONGEST: u64 = 365 * 86_400 * 1_000_000_000;
    let Ok(Record::Chunk { header, .. }) = mcap::parse_record(op::CHUNK, data) else { return None };
    let times =
        [header.message_start_time.checked_sub(start_unix_ns)?, header.message_end_time.checked_sub(start_unix_ns)?];
    (times[0] <= times[1] && times[1] < LONGEST).then_some(times)
}
