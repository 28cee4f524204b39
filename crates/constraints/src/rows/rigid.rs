//! The part of the rows on rigid bodies.

use super::twist::{Twist, TwistRow};

/// Rows over the twists of rigid bodies: at most two bodies a row, none where a row knows only tissue and tool.
#[derive(Clone, Debug, Default)]
pub struct RigidRows {
    /// End of each row in `entries`.
    row_end: Vec<usize>,
    entries: Vec<(u32, TwistRow)>,
}

impl RigidRows {
    /// Memory for `rows` rows.
    pub fn with_capacity(rows: usize) -> Self {
        Self { row_end: Vec::with_capacity(rows), entries: Vec::with_capacity(2 * rows) }
    }

    /// Removes all rows and keeps the memory.
    pub fn clear(&mut self) {
        self.row_end.clear();
        self.entries.clear();
    }

    /// Appends a row of (body, part) entries, each body once.
    pub fn push_row(&mut self, entries: impl IntoIterator<Item = (u32, TwistRow)>) {
        self.entries.extend(entries);
        self.row_end.push(self.entries.len());
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.row_end.len()
    }

    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.row_end.is_empty()
    }

    /// True where no row has a part on a rigid body.
    pub fn touches_nothing(&self) -> bool {
        self.entries.is_empty()
    }

    /// Entries of row `r`; none where there is no such row.
    pub fn row(&self, r: usize) -> &[(u32, TwistRow)] {
        let from = r.checked_sub(1).and_then(|before| self.row_end.get(before)).copied().unwrap_or(0);
        self.row_end.get(r).and_then(|&to| self.entries.get(from..to)).unwrap_or(&[])
    }

    /// Row `r` times the twists of all bodies; bodies without a twist do not move.
    pub fn dot(&self, r: usize, twists: &[Twist]) -> f64 {
        let of_body =
            |&(body, row): &(u32, TwistRow)| twists.get(body as usize).map_or(0.0, |t| row.dot(&t.linear, &t.angular));
        self.row(r).iter().map(of_body).sum()
    }

    /// `x += Hᵀ λ`: force and torque on each body, as the linear and angular part of its entry.
    pub fn add_transposed(&self, lambda: &[f64], x: &mut [Twist]) {
        for (r, &l) in lambda.iter().enumerate().take(self.len()) {
            for (body, row) in self.row(r) {
                if let Some(x) = x.get_mut(*body as usize) {
                    x.linear += row.force * l;
                    x.angular += row.torque * l;
                }
            }
        }
    }
}
