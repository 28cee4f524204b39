//! The nodes of a body that a scene fixes.

use nalgebra::Vector3;
use palpate_fem::mesh::{BoundingBox, TetMesh};

use crate::scene::{NodeSelection, Scene, SceneError};

/// The nodes that the scene fixes.
pub(super) fn fixed_nodes(scene: &Scene, mesh: &TetMesh) -> Result<Vec<u32>, SceneError> {
    let mut fixed = vec![false; mesh.nodes.len()];
    for (k, selection) in scene.description().bodies[0].fixed.iter().enumerate() {
        let place = format!("body.0.fixed.{k}");
        let mut count = 0;
        let mut mark = |node: usize| {
            fixed[node] = true;
            count += 1;
        };
        let within = |inside: &dyn Fn(&Vector3<f64>) -> bool, mark: &mut dyn FnMut(usize)| {
            mesh.nodes.iter().enumerate().filter(|(_, x)| inside(x)).for_each(|(i, _)| mark(i));
        };
        match selection {
            NodeSelection::NodeSet(name) => {
                let Some(nodes) = mesh.node_sets.get(name) else {
                    let known: Vec<_> = mesh.node_sets.keys().map(String::as_str).collect();
                    let message = format!("the mesh has no node set `{name}`");
                    return Err(scene.at(&place, message, format!("its node sets are: {}", known.join(", "))));
                };
                nodes.iter().for_each(|&n| mark(n as usize));
            }
            NodeSelection::Region(name) => {
                let Some(region) = mesh.region_names.iter().position(|r| r == name) else {
                    let message = format!("the mesh has no region `{name}`");
                    return Err(scene.at(&place, message, format!("its regions are {}", mesh.region_names.join(", "))));
                };
                let of_region = mesh.tetrahedra.iter().zip(&mesh.regions).filter(|(_, r)| usize::from(**r) == region);
                of_region.flat_map(|(t, _)| t).for_each(|&n| mark(n as usize));
            }
            NodeSelection::Below(p) => within(&|x| x[p.axis.index()] <= p.at, &mut mark),
            NodeSelection::Above(p) => within(&|x| x[p.axis.index()] >= p.at, &mut mark),
            NodeSelection::Box { min, max } => within(&|x| (0..3).all(|c| min[c] <= x[c] && x[c] <= max[c]), &mut mark),
            NodeSelection::Ball { center, radius } => {
                within(&|x| (x - Vector3::from(*center)).norm() <= *radius, &mut mark);
            }
        }
        if count == 0 {
            let BoundingBox { min: low, max: high } = mesh.bounding_box();
            let message = "this selection holds no node";
            let remedy = format!(
                "the body spans x {:.4}..{:.4}, y {:.4}..{:.4}, z {:.4}..{:.4} m",
                low.x, high.x, low.y, high.y, low.z, high.z
            );
            return Err(scene.at(&place, message, remedy));
        }
    }
    if fixed.iter().all(|&f| f) && !fixed.is_empty() {
        return Err(scene.at("body.0.fixed", "every node is fixed: nothing can move", "fix fewer nodes"));
    }
    Ok((0..fixed.len()).filter(|&n| fixed[n]).map(|n| n as u32).collect())
}
