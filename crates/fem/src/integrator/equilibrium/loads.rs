//! Forces on a body and motions of its fixed nodes.

use nalgebra::Vector3;

use super::EquilibriumError;
use crate::{model::FemModel, sparse::FIXED};

/// A fixed node and the place to which it is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prescribed {
    /// Mesh node; one of the model's fixed nodes.
    pub node: u32,
    /// Where it goes (m).
    pub position: Vector3<f64>,
}

/// What a body is in equilibrium with.
#[derive(Clone, Copy, Debug, Default)]
pub struct Loads<'a> {
    /// One force per mesh node (N), or empty; constant in direction. Gravity is the model's.
    pub f_ext: &'a [Vector3<f64>],
    /// Fixed nodes that move; those not named stay where the state holds them.
    pub prescribed: &'a [Prescribed],
    /// Share of forces and gravity that the state already carries: 0 for a body at rest, 1 to go on from an equilibrium
    /// under the same loads.
    pub carried: f64,
}

impl Loads<'_> {
    /// Whether a body can be in equilibrium with them.
    pub(super) fn check(&self, model: &FemModel) -> Result<(), EquilibriumError> {
        let nodes = model.nodes();
        if model.free_nodes() == nodes && !model.held().contains(&true) {
            return Err(EquilibriumError::Unsupported);
        }
        if !self.f_ext.is_empty() && self.f_ext.len() != nodes {
            return Err(EquilibriumError::ForceCount { forces: self.f_ext.len(), nodes });
        }
        for &Prescribed { node, position } in self.prescribed {
            match model.free_of_node().get(node as usize) {
                None => return Err(EquilibriumError::NoNode { node, nodes }),
                Some(&free) if free != FIXED => return Err(EquilibriumError::FreeNode { node }),
                Some(_) if !position.iter().all(|x| x.is_finite()) => return Err(EquilibriumError::Place { node }),
                Some(_) => {}
            }
        }
        Ok(())
    }
}
