//! What is remembered of a contact on the skin from tick to tick.

use nalgebra::Vector3;

use super::rows::Row;

/// A contact of the tick before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub(super) feature: u64,
    pub(super) force: Vector3<f64>,
    pub(super) slip: Vector3<f64>,
    /// Snapshots that came while it stuck.
    pub(super) stuck: u32,
}

/// Snapshots that a contact must have stuck at to be led: a step looks at the tool after the snapshot before has come.
pub(super) const STUCK: u32 = 2;

impl Known {
    pub(super) fn new(row: &Row) -> Self {
        Self { feature: row.feature, force: row.force, slip: row.slip, stuck: row.stuck }
    }
}
