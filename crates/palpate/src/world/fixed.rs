//! The nodes of a body that a scene fixes.

use palpate_fem::mesh::TetMesh;

use super::selection::nodes_in;
use crate::scene::{Scene, SceneError};

/// For every node whether the scene fixes it.
pub(super) fn fixed_nodes(scene: &Scene, mesh: &TetMesh) -> Result<Vec<bool>, SceneError> {
    let mut fixed = vec![false; mesh.nodes.len()];
    for (k, selection) in scene.description().bodies[0].fixed.iter().enumerate() {
        let nodes = nodes_in(scene, &format!("body.0.fixed.{k}"), selection, mesh)?;
        nodes.into_iter().for_each(|node| fixed[node as usize] = true);
    }
    if fixed.iter().all(|&f| f) && !fixed.is_empty() {
        return Err(scene.at("body.0.fixed", "every node is fixed: nothing can move", "fix fewer nodes"));
    }
    Ok(fixed)
}
