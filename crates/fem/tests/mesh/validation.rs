//! Bad meshes are refused by the name of what is wrong, with the place and the way out.

use crate::format_samples::cube;
use nalgebra::Vector3;
use palpate_fem::mesh::quality::POOR_RADIUS_RATIO;
use palpate_fem::mesh::{MeshError, MeshQuality, MeshWarning, TetMesh};

fn refusal(change: impl FnOnce(&mut TetMesh)) -> MeshError {
    let mut mesh = cube();
    change(&mut mesh);
    mesh.validate().expect_err("the mesh is bad")
}

#[test]
fn a_good_mesh_is_measured() {
    let quality = cube().validate().unwrap();
    assert_eq!((quality.nodes, quality.tetrahedra, quality.surface_triangles), (8, 6, 12));
    assert_eq!((quality.inverted, quality.flat, quality.duplicate, quality.unused), (0, 0, 0, 0));
    // Edges and determinants are powers of two; only the division by six rounds, once for each tetrahedron.
    assert!((quality.volume - 1.0 / 64.0).abs() < 1e-17);
    assert_eq!(quality.bounds, [[0.0; 3], [0.5, 0.25, 0.125]]);
    assert_eq!(quality.edge, [0.125, (0.25 + 0.0625 + 0.015625_f64).sqrt()]);
    assert!((quality.surface_area - 0.4375).abs() < 1e-15);
    let regions: Vec<_> = quality.regions.iter().map(|r| (r.name.as_str(), r.tetrahedra)).collect();
    assert_eq!(regions, [("soft tissue", 3), ("lesion", 3)]);
    assert!(quality.regions.iter().all(|region| (region.volume - 1.0 / 128.0).abs() < 1e-17));
    assert_eq!(quality.node_sets, [("left".to_string(), 4)]);
    assert!(quality.warnings().is_empty());
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let error = refusal(|mesh| mesh.nodes[3].y = value);
        assert!(matches!(error, MeshError::NonFinite { node: 3, .. }), "{error}");
    }
}

#[test]
fn indices_beyond_the_nodes_are_refused() {
    let error = refusal(|mesh| mesh.tetrahedra[4][2] = 8);
    assert!(matches!(&error, MeshError::NodeOutOfRange { node: 8, nodes: 8, .. }), "{error}");
    assert!(error.to_string().contains("tetrahedron 4"));
    let error = refusal(|mesh| mesh.node_sets.get_mut("left").unwrap().push(9));
    assert!(error.to_string().contains("node set \"left\" uses node 9"), "{error}");
}

#[test]
fn lists_that_do_not_fit_together_are_refused() {
    for error in [
        refusal(|mesh| _ = mesh.regions.pop()),
        refusal(|mesh| mesh.regions[2] = 2),
        refusal(|mesh| mesh.region_names[1] = mesh.region_names[0].clone()),
    ] {
        assert!(matches!(error, MeshError::Inconsistent { .. }), "{error}");
    }
    assert!(matches!(TetMesh::default().validate(), Err(MeshError::NoTetrahedra { .. })));
    for factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(cube().scaled(factor), Err(MeshError::Inconsistent { .. })));
    }
}

#[test]
fn some_inverted_tetrahedra_are_refused_and_can_be_turned_round() {
    let turn = |mesh: &mut TetMesh| [1, 4].iter().for_each(|&t| mesh.tetrahedra[t].swap(0, 1));
    let error = refusal(turn);
    let MeshError::Inverted { tetrahedron, volume, inverted, total, first, .. } = &error else { panic!("{error}") };
    assert_eq!((*tetrahedron, *inverted, *total), (1, 2, 6));
    assert_eq!(first, &[1, 4]);
    assert_eq!(*volume, -1.0 / 384.0);
    assert!(error.to_string().contains("TetMesh::reorient"));

    let mut mesh = cube();
    turn(&mut mesh);
    assert_eq!(mesh.reorient(), 2);
    assert!((mesh.validate().unwrap().volume - 1.0 / 64.0).abs() < 1e-17);
}

#[test]
fn flat_tetrahedra_are_refused_whatever_the_size_of_the_mesh() {
    for scale in [1e-6, 1.0, 1e6] {
        let mut mesh = cube().scaled(scale).unwrap();
        assert!(mesh.validate().is_ok(), "scale {scale}");
        // Node 2 moves into the plane of nodes 0, 4 and 7, as far as rounding allows.
        mesh.nodes[2] = (mesh.nodes[0] + mesh.nodes[4] + mesh.nodes[7]) / 3.0;
        let error = mesh.validate().unwrap_err();
        assert!(matches!(error, MeshError::ZeroVolume { .. }), "{error}");
    }
    let error = refusal(|mesh| mesh.tetrahedra[0][1] = mesh.tetrahedra[0][0]);
    assert!(matches!(error, MeshError::ZeroVolume { tetrahedron: 0, volume: 0.0, flat: 1, .. }), "{error}");
}

#[test]
fn duplicates_are_refused_in_any_order_of_their_nodes() {
    let error = refusal(|mesh| {
        let [a, b, c, d] = mesh.tetrahedra[2];
        mesh.tetrahedra.push([b, c, a, d]);
        mesh.regions.push(0);
    });
    assert!(matches!(error, MeshError::Duplicate { tetrahedron: 6, earlier: 2, duplicates: 1, .. }), "{error}");
}

#[test]
fn overlapping_tetrahedra_are_refused() {
    // A seventh tetrahedron on the outer side of the box reaches inwards.
    let error = refusal(|mesh| {
        let [a, b, c] = mesh.surface().triangles[0];
        let inside = mesh.bounding_box().centre();
        mesh.nodes.push(inside);
        mesh.tetrahedra.push([a, c, b, 8]);
        mesh.regions.push(0);
        let last = mesh.tetrahedra.len() - 1;
        if mesh.tetrahedron_volume(last) < 0.0 {
            mesh.tetrahedra[last].swap(2, 3);
        }
    });
    assert!(matches!(error, MeshError::Overlap { tetrahedron: 6, .. }), "{error}");
}

#[test]
fn unused_nodes_are_refused_and_can_be_dropped() {
    let stray = |mesh: &mut TetMesh| {
        mesh.nodes.insert(3, Vector3::new(9.0, 9.0, 9.0));
        let shift = |node: &mut u32| *node += u32::from(*node >= 3);
        mesh.tetrahedra.iter_mut().flatten().for_each(shift);
        mesh.node_sets.values_mut().flatten().for_each(shift);
        mesh.node_sets.insert("stray".to_string(), vec![2, 3]);
    };
    let error = refusal(stray);
    assert!(matches!(error, MeshError::UnusedNodes { node: 3, unused: 1, total: 9, .. }), "{error}");
    assert!(error.to_string().contains("drop_unused_nodes"));

    let mut mesh = cube();
    stray(&mut mesh);
    assert_eq!(mesh.drop_unused_nodes(), 1);
    assert_eq!(mesh.node_sets.remove("stray"), Some(vec![2]));
    assert_eq!(mesh, cube());
    assert_eq!(mesh.drop_unused_nodes(), 0);
}

#[test]
fn a_mesh_of_metres_width_is_taken_for_other_units() {
    let scale = |factor: f64| {
        let warnings = cube().scaled(factor).unwrap().validate().unwrap().warnings();
        warnings.into_iter().find_map(|warning| match warning {
            MeshWarning::Units { scale, .. } => Some(scale),
            _ => None,
        })
    };
    // The diagonal of the box is 0.57 m.
    assert_eq!(scale(1.0), None);
    assert_eq!(scale(5.2), None);
    assert_eq!(scale(10.0), Some(1e-2));
    assert_eq!(scale(1e3), Some(1e-3));
}

#[test]
fn parts_without_a_common_node_are_warned_of() {
    let mut mesh = cube();
    let other = cube();
    mesh.nodes.extend(other.nodes.iter().map(|x| x + Vector3::x()));
    mesh.tetrahedra.extend(other.tetrahedra.iter().map(|t| t.map(|node| node + 8)));
    mesh.regions.extend(&other.regions);
    let quality = mesh.validate().unwrap();
    assert_eq!(quality.parts, 2);
    assert_eq!(quality.surface.euler_characteristic, 4);
    assert_eq!(quality.warnings(), [MeshWarning::Disconnected { parts: 2 }]);
}

fn single(nodes: [[f64; 3]; 4]) -> MeshQuality {
    let mesh = TetMesh {
        nodes: nodes.map(Vector3::from).to_vec(),
        tetrahedra: vec![[0, 1, 2, 3]],
        regions: vec![0],
        region_names: vec!["body".to_string()],
        ..TetMesh::default()
    };
    MeshQuality::measure(&mesh)
}

#[test]
fn shapes_of_known_tetrahedra() {
    // Regular: every dihedral angle is acos(1/3), and R = 3 r. Rounding of some ten operations.
    let regular = single([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]);
    let angle = (1.0_f64 / 3.0).acos().to_degrees();
    assert!(regular.dihedral.iter().all(|measured| (measured - angle).abs() < 1e-12), "{:?}", regular.dihedral);
    assert!((regular.radius_ratio[0] - 1.0).abs() < 1e-14);

    // Corner of a cube: r = (3 - √3)/6, R = √3/2; three right angles and three of acos(1/√3).
    let corner = single([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    assert!((corner.radius_ratio[0] - (3.0_f64.sqrt() - 1.0)).abs() < 1e-14, "{:?}", corner.radius_ratio);
    assert!((corner.dihedral[0] - 3.0_f64.sqrt().recip().acos().to_degrees()).abs() < 1e-12);
    assert!((corner.dihedral[2] - 90.0).abs() < 1e-12);

    // The sliver that the bound for poor elements is explained by.
    let z = 0.012;
    let sliver = single([[0.0, 0.0, z], [1.0, 0.0, -z], [1.0, 1.0, z], [0.0, 1.0, -z]]);
    assert!((sliver.radius_ratio[0] / POOR_RADIUS_RATIO - 1.0).abs() < 0.03, "{:?}", sliver.radius_ratio);

    let flat = single([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!((flat.radius_ratio[0], flat.flat, flat.poor), (0.0, 1, 1));
}

#[test]
fn faults_are_counted_without_refusing() {
    let mut mesh = cube();
    mesh.tetrahedra[0].swap(0, 1);
    mesh.tetrahedra.push(mesh.tetrahedra[3]);
    mesh.regions.push(0);
    mesh.nodes.push(Vector3::zeros());
    let quality = MeshQuality::measure(&mesh);
    assert_eq!((quality.inverted, quality.duplicate, quality.unused, quality.flat), (1, 1, 1, 0));
    assert!(quality.to_string().contains("1 inverted, 0 flat, 1 duplicate tetrahedra, 1 unused nodes"));
}
