//! The nodes and elements of a mesh that a scene chooses.

use nalgebra::Vector3;
use palpate_fem::mesh::{BoundingBox, TetMesh};

use crate::scene::{NodeSelection, Scene, SceneError};

/// The nodes in a selection that stands at `place` in the scene, ascending.
pub(super) fn nodes_in(
    scene: &Scene,
    place: &str,
    selection: &NodeSelection,
    mesh: &TetMesh,
) -> Result<Vec<u32>, SceneError> {
    let mut chosen = match selection {
        NodeSelection::NodeSet(name) => node_set(scene, place, name, mesh)?.to_vec(),
        NodeSelection::Region(name) => {
            let region = region(scene, place, name, mesh)?;
            let of_region = mesh.tetrahedra.iter().zip(&mesh.regions).filter(|(_, r)| usize::from(**r) == region);
            of_region.flat_map(|(t, _)| *t).collect()
        }
        _ => {
            let all = mesh.nodes.iter().enumerate();
            all.filter(|(_, x)| holds(selection, x)).map(|(n, _)| n as u32).collect()
        }
    };
    chosen.sort_unstable();
    chosen.dedup();
    if chosen.is_empty() { Err(nothing(scene, place, "node", mesh)) } else { Ok(chosen) }
}

/// The elements in a selection, ascending: by the mean of their corners, their region, or all their corners.
pub(super) fn elements_in(
    scene: &Scene,
    place: &str,
    selection: &NodeSelection,
    mesh: &TetMesh,
) -> Result<Vec<u32>, SceneError> {
    let all = 0..mesh.tetrahedra.len();
    let chosen: Vec<usize> = match selection {
        NodeSelection::NodeSet(name) => {
            let mut within = vec![false; mesh.nodes.len()];
            node_set(scene, place, name, mesh)?.iter().for_each(|&n| within[n as usize] = true);
            all.filter(|&t| mesh.tetrahedra[t].iter().all(|&n| within[n as usize])).collect()
        }
        NodeSelection::Region(name) => {
            let region = region(scene, place, name, mesh)?;
            all.filter(|&t| mesh.regions.get(t).is_some_and(|&r| usize::from(r) == region)).collect()
        }
        _ => {
            let mean =
                |t: usize| mesh.tetrahedra[t].iter().map(|&n| mesh.nodes[n as usize]).sum::<Vector3<f64>>() / 4.0;
            all.filter(|&t| holds(selection, &mean(t))).collect()
        }
    };
    if chosen.is_empty() {
        return Err(nothing(scene, place, "element", mesh));
    }
    Ok(chosen.into_iter().map(|t| t as u32).collect())
}

/// Whether a place (m) is in a selection by place.
fn holds(selection: &NodeSelection, x: &Vector3<f64>) -> bool {
    match selection {
        NodeSelection::NodeSet(_) | NodeSelection::Region(_) => false,
        NodeSelection::Below(p) => x[p.axis.index()] <= p.at,
        NodeSelection::Above(p) => x[p.axis.index()] >= p.at,
        NodeSelection::Box { min, max } => (0..3).all(|c| min[c] <= x[c] && x[c] <= max[c]),
        NodeSelection::Ball { center, radius } => (x - Vector3::from(*center)).norm() <= *radius,
    }
}

fn node_set<'m>(scene: &Scene, place: &str, name: &str, mesh: &'m TetMesh) -> Result<&'m [u32], SceneError> {
    mesh.node_sets.get(name).map(Vec::as_slice).ok_or_else(|| {
        let known: Vec<_> = mesh.node_sets.keys().map(String::as_str).collect();
        let message = format!("the mesh has no node set `{name}`");
        let remedy = match known.as_slice() {
            [] => "it has no node sets; choose nodes by place, as { below = { axis = \"z\", at = 0.0 } }".into(),
            _ => format!("its node sets are: {}", known.join(", ")),
        };
        scene.at(place, message, remedy)
    })
}

fn region(scene: &Scene, place: &str, name: &str, mesh: &TetMesh) -> Result<usize, SceneError> {
    mesh.region_names.iter().position(|r| r == name).ok_or_else(|| {
        let message = format!("the mesh has no region `{name}`");
        scene.at(place, message, format!("its regions are {}", mesh.region_names.join(", ")))
    })
}

fn nothing(scene: &Scene, place: &str, what: &str, mesh: &TetMesh) -> SceneError {
    let BoundingBox { min: low, max: high } = mesh.bounding_box();
    let remedy = format!(
        "the body spans x {:.4}..{:.4}, y {:.4}..{:.4}, z {:.4}..{:.4} m",
        low.x, high.x, low.y, high.y, low.z, high.z
    );
    scene.at(place, format!("this selection holds no {what}"), remedy)
}
