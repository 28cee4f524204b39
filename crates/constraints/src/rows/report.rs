//! What became of contacts.

use super::ContactRows;

/// What became of the contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RowReport {
    /// Contacts that got rows.
    pub contacts: usize,
    /// Rows built.
    pub rows: usize,
    /// Contacts on fixed nodes alone: nothing there can move; see [`build_fixed_rows`](super::build_fixed_rows).
    pub rigid: usize,
    /// Contacts beyond the capacity stated at set-up.
    pub dropped: usize,
    /// Contacts with a number that is not finite or a node that the body does not have.
    pub invalid: usize,
}

impl RowReport {
    /// Counts a contact whose rows `push` appends, where there is room for them.
    pub(super) fn push(&mut self, rows: &mut ContactRows, push: impl FnOnce(&mut ContactRows) -> usize) {
        if rows.blocks.len() == rows.capacity {
            self.dropped += 1;
            return;
        }
        self.contacts += 1;
        self.rows += push(rows);
    }

    /// Both counts together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            contacts: self.contacts + other.contacts,
            rows: self.rows + other.rows,
            rigid: self.rigid + other.rigid,
            dropped: self.dropped + other.dropped,
            invalid: self.invalid + other.invalid,
        }
    }
}
