//! A body that is cut, held or released while it runs.

use nalgebra::Vector3;

use super::{FemConfig, FemError, FemModel, FemState, setup::number_free_nodes};
use crate::{
    element::{ElementKind, quadratic::POINTS},
    mesh::TetMesh,
};

impl FemModel {
    /// The body after a change: `mesh` has the nodes of this body's and some or all of its tetrahedra, `config` its choices
    /// with other nodes held. Nodes that lost all their tetrahedra are held as well. Both bodies have one pattern and one
    /// numbering of the free nodes, so that matrices, factors and states of the one fit the other.
    ///
    /// `self` must have every tetrahedron that a change leaves: begin with the whole body.
    ///
    /// # Errors
    /// Those of [`FemModel::new`]; nodes, fixed nodes or elements of another kind; averaged elements, whose coupling each
    /// change makes anew.
    pub fn changed(&self, mesh: &TetMesh, config: &FemConfig) -> Result<Self, FemError> {
        let differs = |what| Err(FemError::Changed { what });
        if mesh.nodes != self.q_rest {
            return differs("nodes");
        }
        if config.element != self.kind {
            return differs("elements");
        }
        if self.kind == ElementKind::Averaged {
            return Err(FemError::ChangedAverages);
        }
        config.validate(mesh)?;
        if number_free_nodes(mesh.nodes.len(), &config.fixed).1 != self.node_of_free {
            return differs("fixed nodes");
        }
        let mut changed = Self::on_pattern(mesh, config, Some(&self.pattern))?;
        changed.held_mass = self.held_mass;
        let corners = changed.elements.iter().map(|e| e.nodes.map(|node| changed.free_of_node[node as usize]));
        let mids = changed.quadratic.iter().map(|e| e.nodes.map(|node| changed.free_of_node[node as usize]));
        let coupled = |nodes: &[u32]| {
            let mut pairs = nodes.iter().flat_map(|i| nodes.iter().map(move |j| (*i, *j)));
            pairs.all(|(i, j)| i.max(j) as usize >= self.node_of_free.len() || self.pattern.find(i, j).is_some())
        };
        if !corners.into_iter().all(|nodes| coupled(&nodes)) || !mids.into_iter().all(|nodes| coupled(&nodes)) {
            return differs("tetrahedra");
        }
        Ok(changed)
    }
}

impl FemState {
    /// Takes over `before`, a state of `from`, as a state of the changed body `to`: positions and velocities of the nodes,
    /// and the memory of the elements that remain. Held nodes stop where they are. Allocates nothing.
    ///
    /// `place` gives for each tetrahedron of the mesh of `to` its number in the mesh of `from`.
    pub fn carry(&mut self, before: &Self, from: &FemModel, to: &FemModel, place: &CarriedMemory) {
        self.q.copy_from_slice(&before.q);
        self.v.copy_from_slice(&before.v);
        for (&node, _) in to.node_of_free.iter().zip(&to.held).filter(|(_, held)| **held) {
            self.v[node as usize] = Vector3::zeros();
        }
        debug_assert_eq!(before.memory.len(), from.memory);
        for (to, &from) in self.memory.iter_mut().zip(&place.source) {
            *to = before.memory.get(from as usize).copied().unwrap_or_default();
        }
    }
}

/// Where the memory of a changed body's elements lies in that of the body before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CarriedMemory {
    /// For each entry of the memory its entry before.
    source: Vec<u32>,
}

impl CarriedMemory {
    /// Entries of the memory of the changed body.
    pub fn len(&self) -> usize {
        self.source.len()
    }

    /// True where the changed body remembers nothing.
    pub fn is_empty(&self) -> bool {
        self.source.is_empty()
    }

    /// `place` gives for each tetrahedron of the mesh of `to` its number in the mesh of `from`, of the same material.
    pub fn new(from: &FemModel, to: &FemModel, place: &[u32]) -> Self {
        let starts = |model: &FemModel| {
            let points = if model.kind == ElementKind::Quadratic { POINTS } else { 1 };
            let mut start = vec![u32::MAX; model.elements.len()];
            for batch in &model.batches {
                let terms = points * batch.tissue.viscosity.len();
                for (k, e) in batch.elements.clone().enumerate().filter(|_| terms > 0) {
                    start[model.mesh_tetrahedron[e] as usize] = (batch.memory.start + k * terms) as u32;
                }
            }
            start
        };
        let before = starts(from);
        let mut source = vec![u32::MAX; to.memory];
        let points = if to.kind == ElementKind::Quadratic { POINTS } else { 1 };
        for batch in &to.batches {
            let terms = points * batch.tissue.viscosity.len();
            for (k, e) in batch.elements.clone().enumerate() {
                let tetrahedron = to.mesh_tetrahedron[e] as usize;
                let start = place.get(tetrahedron).and_then(|&t| before.get(t as usize)).copied().unwrap_or(u32::MAX);
                for term in 0..terms {
                    source[batch.memory.start + k * terms + term] = start.saturating_add(term as u32);
                }
            }
        }
        Self { source }
    }
}
