//! λ from tick to tick, and across snapshots by contact identity.
//!
//! Within a snapshot λ is where the last tick left it. At a new snapshot a contact that was there before keeps its
//! force *in the world*: the tangents may have turned, so F = Σ dᵢ λᵢ is projected onto the new directions,
//! λ'ᵢ = d'ᵢ · F, and onto the law. A contact without a direction on the tool keeps its numbers. A contact that was not
//! there starts from what the step found.

use nalgebra::Vector3;
use palpate_constraints::law::Law;

use crate::snapshot::{HapticSnapshot, ROWS_PER_CONTACT};

/// λ and the identity of its contacts: state, of fixed size.
#[derive(Clone, Debug)]
pub(crate) struct WarmStart {
    lambda: Vec<f64>,
    next: Vec<f64>,
    contacts: Vec<Known>,
    count: usize,
}

/// A contact of the snapshot that `lambda` belongs to.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    feature: u64,
    start: usize,
    rows: usize,
    directions: [Vector3<f64>; ROWS_PER_CONTACT],
}

impl Known {
    fn new(snapshot: &HapticSnapshot, feature: u64, start: usize, law: &Law) -> Self {
        let rows = law.rows();
        let mut directions = [Vector3::zeros(); ROWS_PER_CONTACT];
        let lines = snapshot.tool_rows().get(start..start + rows).unwrap_or_default();
        for (direction, line) in directions.iter_mut().zip(lines) {
            *direction = Vector3::new(line[0], line[1], line[2]);
        }
        Self { feature, start, rows, directions }
    }

    fn touches_tool(&self) -> bool {
        self.directions[0] != Vector3::zeros()
    }

    /// The force of `old` in the rows of `self`.
    fn carry(&self, old: &Self, lambda: &[f64]) -> Option<Vector3<f64>> {
        let known = lambda.get(old.start..old.start + old.rows)?;
        let mut carried = Vector3::zeros();
        if self.touches_tool() && old.touches_tool() {
            let force: Vector3<f64> = old.directions.iter().zip(known).map(|(d, l)| d * *l).sum();
            for (c, d) in carried.iter_mut().zip(&self.directions) {
                *c = d.dot(&force);
            }
        } else {
            for (c, l) in carried.iter_mut().zip(known) {
                *c = *l;
            }
        }
        Some(carried)
    }
}

impl WarmStart {
    pub(crate) fn new(max_contacts: usize) -> Self {
        let rows = ROWS_PER_CONTACT * max_contacts;
        let contacts = vec![Known::default(); max_contacts];
        Self { lambda: vec![0.0; rows], next: vec![0.0; rows], contacts, count: 0 }
    }

    /// λ of the first `rows` rows; fewer if there is no room.
    pub(crate) fn lambda_mut(&mut self, rows: usize) -> &mut [f64] {
        let room = rows.min(self.lambda.len());
        &mut self.lambda[..room]
    }

    pub(crate) fn max_contacts(&self) -> usize {
        self.contacts.len()
    }

    /// Forgets the forces, not the contacts.
    pub(crate) fn clear_forces(&mut self) {
        self.lambda.fill(0.0);
    }

    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.clear_forces();
        self.count = 0;
    }

    /// Makes λ belong to `snapshot`. At most `max_contacts²` comparisons.
    pub(crate) fn take_over(&mut self, snapshot: &HapticSnapshot) {
        let fitting = snapshot.contacts().min(self.contacts.len());
        for (block, feature) in snapshot.blocks().iter().zip(snapshot.features()).take(fitting) {
            let now = Known::new(snapshot, *feature, block.start, &block.law);
            let old = self.contacts.iter().take(self.count).find(|old| old.feature == now.feature);
            let rows = now.start..now.start + now.rows;
            let (Some(next), Some(found)) = (self.next.get_mut(rows.clone()), snapshot.lambda().get(rows)) else {
                continue;
            };
            let mut start = Vector3::zeros();
            for (s, l) in start.iter_mut().zip(found) {
                *s = *l;
            }
            let start = old.and_then(|old| now.carry(old, &self.lambda)).unwrap_or(start);
            for (n, s) in next.iter_mut().zip(block.law.project(&start).iter()) {
                *n = *s;
            }
        }
        std::mem::swap(&mut self.lambda, &mut self.next);
        for (i, (block, feature)) in snapshot.blocks().iter().zip(snapshot.features()).take(fitting).enumerate() {
            if let Some(known) = self.contacts.get_mut(i) {
                *known = Known::new(snapshot, *feature, block.start, &block.law);
            }
        }
        self.count = fitting;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::SnapshotContact;
    use palpate_constraints::law::Coulomb;

    /// Feature, frame and the step's λ.
    type Given = (u64, [Vector3<f64>; 3], [f64; 3]);

    fn snapshot(step: u64, contacts: &[Given]) -> HapticSnapshot {
        let mut snapshot = HapticSnapshot::new(4);
        snapshot.clear();
        (snapshot.step, snapshot.valid) = (step, true);
        for (feature, frame, lambda) in contacts {
            let tool_rows = frame.map(|d| [d.x, d.y, d.z, 0.0, 0.0, 0.0]);
            let law = Coulomb { friction: 0.5 }.into();
            let contact =
                SnapshotContact { law, feature: *feature, tool_rows: &tool_rows, delta_free: &[0.0; 3], lambda };
            assert!(snapshot.push(&contact));
        }
        snapshot
    }

    #[test]
    fn force_in_the_world_survives_a_turn_of_the_tangents_and_a_change_of_order() {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let mut warm = WarmStart::new(4);
        warm.take_over(&snapshot(1, &[(7, [z, x, y], [2.0, 0.3, -0.4]), (9, [z, x, y], [1.0, 0.0, 0.1])]));
        let turned = [z, y, -x];
        warm.take_over(&snapshot(2, &[(3, [z, x, y], [5.0, 0.0, 0.0]), (7, turned, [0.0; 3])]));
        assert_eq!(warm.lambda_mut(6), [5.0, 0.0, 0.0, 2.0, -0.4, -0.3]);
    }

    #[test]
    fn a_contact_that_left_and_came_back_starts_from_the_step() {
        let frame = [Vector3::z(), Vector3::x(), Vector3::y()];
        let mut warm = WarmStart::new(4);
        warm.take_over(&snapshot(1, &[(7, frame, [2.0, 0.0, 0.0])]));
        warm.take_over(&snapshot(2, &[]));
        warm.take_over(&snapshot(3, &[(7, frame, [0.5, 0.0, 0.0])]));
        assert_eq!(warm.lambda_mut(3), [0.5, 0.0, 0.0]);
    }
}
