//! What is remembered of a contact on the skin from tick to tick.

use nalgebra::Vector3;

use super::rows::Row;
use crate::wrench::all_finite;

/// A contact of the tick before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub(super) feature: u64,
    pub(super) force: Vector3<f64>,
    pub(super) slip: Vector3<f64>,
    /// Snapshots that came while it stuck.
    pub(super) stuck: u32,
    /// What the sweeps left of its gap \[m\].
    pub(super) rest: f64,
    pub(super) owed: Owed,
}

/// What the sweeps had left of a contact when the snapshot came \[m\], and what is asked for again as s falls: the new
/// snapshot yields otherwise than the old, and would let out at once what had gathered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Owed {
    pub(super) gap: f64,
    /// Along the tangents, in the world.
    pub(super) slip: Vector3<f64>,
}

impl Owed {
    pub(super) const NONE: Self = Self { gap: 0.0, slip: Vector3::new(0.0, 0.0, 0.0) };

    /// A new snapshot comes when s of the one before is `fade`: what was owed is so with what has been left since, and
    /// no slip is asked for at once.
    pub(super) fn defer(&mut self, fade: f64, rest: f64, slip: &mut Vector3<f64>) {
        let owed = Self { gap: self.gap * fade + rest, slip: self.slip * fade + *slip };
        *self = if owed.gap.is_finite() && all_finite(&owed.slip) { owed } else { Self::NONE };
        *slip = Vector3::zeros();
    }
}

/// Snapshots that a contact must have stuck at to be led: a step looks at the tool after the snapshot before has come.
pub(super) const STUCK: u32 = 2;

impl Known {
    pub(super) fn new(row: &Row) -> Self {
        Self {
            feature: row.feature,
            force: row.force,
            slip: row.slip,
            stuck: row.stuck,
            rest: row.rest(),
            owed: row.owed,
        }
    }
}
