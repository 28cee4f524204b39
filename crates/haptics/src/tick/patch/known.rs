//! What is remembered of a contact on the skin from tick to tick.

use nalgebra::Vector3;
use palpate_collision::SkinPatch;
use palpate_collision::patch::renumbering::NO_NODE;

use super::memory::PatchMemory;
use super::rows::Row;
use crate::wrench::all_finite;

/// A contact of the tick before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub(super) feature: u64,
    /// Names of the feature's nodes, ascending, and [`NO_NODE`] behind them: they outlast a cut, which numbers features anew.
    pub(super) nodes: [u32; 3],
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
    /// Of a contact on the skin, whose nodes have these names; the first is at place `first`.
    pub(super) fn new(row: &Row, (names, first): (&[u32], usize)) -> Self {
        let mut nodes = [NO_NODE; 3];
        for (to, (place, _)) in nodes.iter_mut().zip(&row.places[..row.count]) {
            *to = place.checked_sub(first).and_then(|k| names.get(k)).copied().unwrap_or(NO_NODE);
        }
        nodes.sort_unstable();
        Self {
            feature: row.feature,
            nodes,
            force: row.force,
            slip: row.slip,
            stuck: row.stuck,
            rest: row.rest(),
            owed: row.owed,
        }
    }
}

impl PatchMemory {
    /// Features have other names from now on, those of this skin: what is remembered of a contact goes to the one at the same
    /// nodes, and is dropped where there is none. At most one look at the skin's edges or triangles a contact.
    pub(in crate::tick) fn renumber(&mut self, skin: &SkinPatch) {
        self.contacts.retain_mut(|known| {
            let now = skin.renumbered(known.feature, &known.nodes);
            known.feature = now.unwrap_or(known.feature);
            now.is_some()
        });
        self.contacts.sort_unstable_by_key(|known| known.feature);
    }
}
