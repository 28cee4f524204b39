//! Where the bytes go.

use std::fs::File;
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A destination that can also be cut back, so that what was written before a failure can be closed properly.
pub trait TraceSink: Write {
    /// Cuts to `length` bytes and goes on writing there.
    ///
    /// # Errors
    /// What the system answers.
    fn truncate(&mut self, length: u64) -> io::Result<()>;
}

impl TraceSink for File {
    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)?;
        self.seek(SeekFrom::Start(length)).map(drop)
    }
}

impl TraceSink for Cursor<Vec<u8>> {
    fn truncate(&mut self, length: u64) -> io::Result<()> {
        let kept = usize::try_from(length).map_err(io::Error::other)?;
        self.get_mut().truncate(kept);
        self.set_position(length);
        Ok(())
    }
}

/// Counts what passes; the count is readable while the MCAP writer owns the sink.
pub(crate) struct CountingSink<S> {
    pub(crate) inner: S,
    count: Arc<AtomicU64>,
}

impl<S> CountingSink<S> {
    pub(crate) fn new(inner: S) -> (Self, Arc<AtomicU64>) {
        let count = Arc::new(AtomicU64::new(0));
        (Self { inner, count: Arc::clone(&count) }, count)
    }
}

impl<S: Write> Write for CountingSink<S> {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(data)?;
        self.count.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
