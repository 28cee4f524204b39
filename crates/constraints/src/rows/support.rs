//! What of the tissue carries a contact.

use nalgebra::Vector3;
use palpate_collision::Contact;
use palpate_fem::sparse::FIXED;

use super::RowInput;

/// The free nodes that carry a contact, each once, and the velocity of its point in the free motion.
pub(super) struct Support {
    nodes: [(u32, f64); 3],
    len: usize,
    /// Velocity of the point (m/s).
    pub(super) velocity: Vector3<f64>,
}

impl Support {
    /// None where a node is unknown or a number is not finite.
    pub(super) fn new(contact: &Contact, input: &RowInput) -> Option<Self> {
        let finite =
            contact.gap.is_finite() && contact.normal.iter().chain(contact.tissue_point.iter()).all(|x| x.is_finite());
        if !finite {
            return None;
        }
        let mut support = Self { nodes: [(0, 0.0); 3], len: 0, velocity: Vector3::zeros() };
        for (&node, &weight) in contact.nodes.iter().zip(&contact.weights) {
            let free = *input.free_of_node.get(node as usize)?;
            if free == FIXED || weight == 0.0 {
                continue;
            }
            let at = 3 * free as usize;
            let v = input.v_free.get(at..at + 3)?;
            support.velocity += Vector3::new(v[0], v[1], v[2]) * weight;
            // A row holds a node once: weights of a repeated node add up.
            match support.nodes[..support.len].iter_mut().find(|(n, _)| *n == free) {
                Some((_, sum)) => *sum += weight,
                None => {
                    support.nodes[support.len] = (free, weight);
                    support.len += 1;
                }
            }
        }
        support.velocity.iter().all(|x| x.is_finite()).then_some(support)
    }

    /// True where nothing under the contact can move.
    pub(super) fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Free nodes and their weights.
    pub(super) fn entries(&self) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.nodes[..self.len].iter().copied()
    }
}
