//! The end state of a body as VTU, for ParaView and meshio.

use std::path::Path;

use nalgebra::Vector3;
use palpate_fem::format::{PointData, write_vtu};
use palpate_fem::mesh::{MeshError, TetMesh};
use palpate_fem::model::FemState;

use crate::world::World;

/// Writes the deformed mesh with displacement from the mesh of the scene (m) and velocity (m/s) at each node.
///
/// # Errors
/// The file cannot be written.
pub fn write_state(path: &Path, world: &World, state: &FemState) -> Result<(), MeshError> {
    let displacement: Vec<Vector3<f64>> = state.q.iter().zip(&world.mesh().nodes).map(|(q, x)| q - x).collect();
    let mesh = TetMesh { nodes: state.q.clone(), ..world.mesh().clone() };
    let data = [("displacement", PointData::Vectors(&displacement)), ("velocity", PointData::Vectors(&state.v))];
    write_vtu(path, &mesh, &data)
}
