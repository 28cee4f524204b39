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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_that_lock_are_warned_of_with_a_remedy_that_the_law_can_take() {
        let warned = |law: &str, element, poisson| {
            let material = Material::from_young_poisson(law, 5e3, poisson).expect("a registered law");
            warning(element, "the body", &material)
        };
        for law in ["neo_hookean", "mooney_rivlin", "ogden", "stable_neo_hookean"] {
            for element in ElementKind::ALL {
                assert_eq!(warned(law, element, element.highest_poisson()), None, "{law}, {element:?}");
            }
            let linear = warned(law, ElementKind::Linear, 0.49).expect("linear tetrahedra lock");
            assert!(linear.contains("0.49000") && linear.contains("\"averaged\"") && linear.contains("\"quadratic\""));
            let quadratic = warned(law, ElementKind::Quadratic, 0.499).expect("quadratic ones at last");
            assert!(quadratic.contains("\"averaged\"") && !quadratic.contains("lower it"), "{quadratic}");
            let averaged = warned(law, ElementKind::Averaged, 0.49995).expect("badly conditioned");
            assert!(averaged.contains("lower it to 0.4999") && averaged.contains("conditioned"), "{averaged}");
            let both = warned(law, ElementKind::Linear, 0.49995).expect("both");
            assert!(both.contains("lower it to 0.4999") && both.contains("\"averaged\""), "{both}");
        }
        // Without a bulk term of its own a law has no averaged elements.
        for law in ["linear", "corotational", "st_venant_kirchhoff"] {
            let linear = warned(law, ElementKind::Linear, 0.49).expect("linear tetrahedra lock");
            assert!(linear.contains("\"quadratic\"") && !linear.contains("\"averaged\""), "{linear}");
            let quadratic = warned(law, ElementKind::Quadratic, 0.499).expect("quadratic ones at last");
            assert!(quadratic.contains("lower it to 0.495"), "{quadratic}");
        }
    }

    #[test]
    fn mid_nodes_that_an_element_leaves_out_are_warned_of() {
        let side = [0.0, 0.01];
        let linear = palpate_fem::block::block(&side, &side, &side);
        let mut warnings = Vec::new();
        assert!(with_nodes_for(ElementKind::Quadratic, linear.clone(), &mut warnings).is_quadratic());
        assert!(warnings.is_empty());
        let back = with_nodes_for(ElementKind::Averaged, linear.promoted(), &mut warnings);
        assert_eq!(back, linear);
        assert!(warnings.len() == 1 && warnings[0].contains("element = \"quadratic\""), "{warnings:?}");
    }
}
