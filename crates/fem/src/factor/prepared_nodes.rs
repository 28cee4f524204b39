//! Half solves of nodes by whoever makes a factor, for the step that gets it.
//!
//! The first step with a new factor wants the half solves of all nodes at its contacts and around its tool at once, which
//! takes as long as several solves. Nearly all of them are those of the step before: whoever made the factor can solve for
//! them beside the steps, and hand them over with it.

use super::half_block::HalfBlock;
use super::nodal_compliance::NodalCompliance;
use super::numeric::Factor;
use super::reach::ReachWorkspace;

/// Latest compliances of which a step is expected to want the nodes again: that of its contacts, and that of the tissue
/// around its tool.
const LATEST: u64 = 2;

impl NodalCompliance {
    /// Solves for `nodes`, in the place of whatever was kept. Nodes that the body does not have, and those beyond the room,
    /// are left out. Nothing where the factor is invalid or of another topology. Allocates nothing.
    pub fn prepare(&mut self, factor: &Factor, nodes: &[u32]) {
        let symbolic = factor.symbolic();
        self.revision = 0;
        if !factor.is_valid() || !self.is_for(symbolic.nodes()) {
            return;
        }
        self.turn_to(factor);
        // No compliance has wanted them yet.
        self.compliances = 0;
        let known = nodes.iter().copied().filter(|&node| (node as usize) < symbolic.nodes());
        // Where they are more than there is room for, the first.
        let _ = self.look_up(known.take(self.capacity));
        if self.has_room() {
            self.append(factor);
        } else {
            self.unmark();
        }
    }

    /// Whether these are half solves with that factor.
    pub fn is_of(&self, factor: &Factor) -> bool {
        factor.is_valid() && self.revision == factor.revision()
    }

    /// Number of nodes that are kept.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether none is kept.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Most nodes that it has room for.
    pub fn capacity(&self) -> usize {
        self.capacity
    }
}

impl Clone for NodalCompliance {
    /// As much memory, with nothing in it.
    fn clone(&self) -> Self {
        let blocks = self.blocks.iter().map(HalfBlock::empty_like).collect();
        Self::empty(self.capacity, blocks, self.place.len(), self.most_entries / 3)
    }
}

impl ReachWorkspace {
    /// Memory for half solves that are prepared for this workspace; `None` where it keeps none.
    pub fn room_for_prepared(&self) -> Option<Box<NodalCompliance>> {
        self.nodal.clone()
    }

    /// Lists the free nodes that the latest compliances wanted, so that they can be prepared for the next; as many as `into`
    /// has room for.
    pub fn latest_nodes(&self, into: &mut Vec<u32>) {
        into.clear();
        let Some(nodal) = &self.nodal else { return };
        let is_latest = |at: u64| at > 0 && at + LATEST > nodal.compliances;
        let latest = nodal.nodes.iter().zip(&nodal.wanted_at).filter(|(_, at)| is_latest(**at));
        into.extend(latest.map(|(node, _)| *node).take(into.capacity()));
    }

    /// Takes over half solves with `factor` that were prepared, and leaves the memory of its own in their place;
    /// nothing where they are of another factor, or where it has some of this one.
    pub fn take_prepared(&mut self, factor: &Factor, prepared: &mut NodalCompliance) {
        let Some(nodal) = self.nodal.as_deref_mut().filter(|nodal| !nodal.is_of(factor)) else { return };
        if prepared.is_of(factor) && prepared.most_entries == nodal.most_entries {
            // Its rows are gone with it.
            if self.by_nodes {
                (self.rows, self.revision, self.by_nodes) = (0, 0, false);
            }
            prepared.compliances = nodal.compliances;
            std::mem::swap(nodal, prepared);
        }
    }

    /// Number of nodes whose half solves it keeps.
    pub fn kept_nodes(&self) -> usize {
        self.nodal.as_ref().map_or(0, |nodal| nodal.len())
    }
}
