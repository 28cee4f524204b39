//! The elements that a scene chooses: the nodes that they need, and materials that do not suit them.

use std::collections::BTreeMap;

use palpate_fem::element::ElementKind;
use palpate_fem::material::{Law, Material};
use palpate_fem::mesh::TetMesh;

use crate::scene::BodyDescription;

/// The mesh with mid-nodes where quadratic elements need them, without where others do not.
pub(super) fn with_nodes_for(element: ElementKind, mesh: TetMesh, warnings: &mut Vec<String>) -> TetMesh {
    match (element, mesh.is_quadratic()) {
        (ElementKind::Quadratic, false) => mesh.promoted(),
        (ElementKind::Linear | ElementKind::Averaged, true) => {
            let name = element.name();
            warnings.push(format!(
                "the mesh has mid-nodes, which {name} elements leave out; use them with `element = \"quadratic\"`"
            ));
            mesh.linear()
        }
        _ => mesh,
    }
}

/// Warnings of materials whose Poisson's ratio is too high for the elements, each with the remedy.
pub(super) fn locking(body: &BodyDescription, mesh: &TetMesh) -> Vec<String> {
    let unnamed = mesh.region_names.iter().any(|name| !body.regions.contains_key(name));
    let whole = unnamed.then_some(("the body", &body.material.law));
    let places: BTreeMap<_, _> =
        whole.into_iter().chain(body.regions.iter().map(|(n, tissue)| (n.as_str(), &tissue.law))).collect();
    places.into_iter().filter_map(|(place, material)| warning(body.element, place, material)).collect()
}

fn warning(element: ElementKind, place: &str, material: &Material) -> Option<String> {
    let poisson = material.small_strain().poisson();
    let highest = element.highest_poisson();
    // The slack is for ratios that are computed from other moduli.
    if poisson <= highest + 1e-9 {
        return None;
    }
    let name = element.name();
    let most = ElementKind::Averaged.highest_poisson();
    let other = match (element, material.without_bulk().is_some()) {
        (ElementKind::Averaged, _) => format!("lower it to {most}"),
        (_, true) if poisson > most + 1e-9 => format!("lower it to {most} and set `element = \"averaged\"`"),
        (ElementKind::Linear, false) => "set `element = \"quadratic\"`".into(),
        (ElementKind::Linear, true) => "set `element = \"averaged\"` or `\"quadratic\"`".into(),
        (_, true) => "set `element = \"averaged\"`".into(),
        (_, false) => format!("lower it to {highest}, or use a law with a bulk term and `element = \"averaged\"`"),
    };
    let wrong = match element {
        ElementKind::Averaged => "the system is badly conditioned",
        _ => "they lock: the body is too stiff and its pressure wrong",
    };
    Some(format!("{place}: Poisson's ratio {poisson:.5} is above {highest} for {name} elements ({wrong}); {other}"))
}
