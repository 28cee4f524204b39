//! The rest shapes of a body's elements and the masses of its nodes.

use super::FemError;
use crate::{
    element::{
        ElementKind, QuadraticTetrahedron, Tetrahedron,
        quadratic::{CORNER_MASS, MID_NODE_MASS},
    },
    mesh::TetMesh,
};

/// Rest shapes, and the lumped mass of every node (kg).
pub(super) struct Elements {
    pub(super) tetrahedra: Vec<Tetrahedron>,
    /// Empty unless the body is quadratic.
    pub(super) quadratic: Vec<QuadraticTetrahedron>,
    pub(super) mass: Vec<f64>,
    /// Nodes of no element.
    pub(super) loose: Vec<u32>,
}

impl Elements {
    /// The tetrahedra of the mesh in the given order; `density` (kg/m³) by tetrahedron of the mesh.
    pub(super) fn new(
        mesh: &TetMesh,
        order: &[u32],
        kind: ElementKind,
        density: impl Fn(u32) -> f64,
    ) -> Result<Self, FemError> {
        let quadratic = kind == ElementKind::Quadratic;
        if quadratic != mesh.is_quadratic() {
            return Err(FemError::Order { kind, mid_nodes: mesh.mid_nodes.len() });
        }
        if quadratic && mesh.mid_nodes.len() != mesh.tetrahedra.len() {
            let (tetrahedra, mid_nodes) = (mesh.tetrahedra.len(), mesh.mid_nodes.len());
            return Err(FemError::MidNodeCount { tetrahedra, mid_nodes });
        }
        let mut elements = Self {
            tetrahedra: Vec::with_capacity(order.len()),
            quadratic: Vec::with_capacity(if quadratic { order.len() } else { 0 }),
            mass: vec![0.0; mesh.nodes.len()],
            loose: Vec::new(),
        };
        let mut connected = vec![false; mesh.nodes.len()];
        let mut share = |node: u32, share: f64| {
            elements.mass[node as usize] += share;
            connected[node as usize] = true;
        };
        for &t in order {
            let tetrahedron = t as usize;
            let element = Tetrahedron::new(mesh.tetrahedra[tetrahedron], &mesh.nodes)
                .ok_or_else(|| FemError::Volume { tetrahedron, volume: volume(mesh, tetrahedron) })?;
            match mesh.ten_nodes(tetrahedron) {
                Some(nodes) => {
                    let curved = QuadraticTetrahedron::new(nodes, &mesh.nodes)
                        .map_err(|error| FemError::MidNode { tetrahedron, error })?;
                    let mass = density(t) * curved.volume();
                    for (a, node) in nodes.into_iter().enumerate() {
                        share(node, mass * if a < 4 { CORNER_MASS } else { MID_NODE_MASS });
                    }
                    elements.quadratic.push(curved);
                }
                None => {
                    for node in element.nodes {
                        share(node, 0.25 * density(t) * element.volume);
                    }
                }
            }
            elements.tetrahedra.push(element);
        }
        elements.loose = (0..).zip(connected).filter(|(_, connected)| !connected).map(|(node, _)| node).collect();
        Ok(elements)
    }
}

/// Volume of a tetrahedron of the mesh (m³).
fn volume(mesh: &TetMesh, t: usize) -> f64 {
    let [a, b, c, d] = mesh.tetrahedra[t].map(|i| mesh.nodes[i as usize]);
    (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
}
