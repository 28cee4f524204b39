//! Metadata that is handed over while a trace is written, by a thread that may wait.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::drain::Progress;

/// The end of whoever hands metadata over. It allocates and takes a lock that the trace takes too, for as long as a list is
/// taken: not for a thread with a deadline.
#[derive(Clone, Debug)]
pub struct MetadataTrace(pub(crate) Arc<Progress>);

impl MetadataTrace {
    /// Hands a metadata record over. It lies in the file, not only in the memory of the trace, before any step that is
    /// pushed after this call.
    pub fn put(&self, name: &str, entries: BTreeMap<String, String>) {
        self.0.put_metadata(name.into(), entries);
    }
}
