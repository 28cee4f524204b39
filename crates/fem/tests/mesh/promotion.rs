//! Ten-node meshes: made from four-node ones, written, read back, and refused where mid-nodes are misplaced.

use std::path::Path;

use crate::tissue_setup::{block, nodes_where};
use nalgebra::Vector3;
use palpate_fem::{
    element::{ElementKind, quadratic::EDGES},
    format::{inspect_bytes, read, write_msh, write_vtu},
    mesh::{MeshError, TetMesh},
    model::{FemConfig, FemError, FemModel},
};

/// A block with two regions and a node set.
fn linear() -> TetMesh {
    let mut mesh = block([2, 3, 2], [0.04, 0.06, 0.05], 0.15);
    mesh.region_names = vec!["soft".into(), "stiff".into()];
    mesh.regions = (0..mesh.tetrahedra.len()).map(|t| (t % 3 == 0) as u16).collect();
    mesh.node_sets.insert("bottom".into(), nodes_where(&mesh, |x| x.z < 1e-9));
    mesh
}

#[test]
fn promotion_shares_mid_nodes_and_keeps_regions_and_sets() {
    let mesh = linear();
    let quadratic = mesh.promoted();
    quadratic.validate().unwrap();
    // A mesh of a ball has as many nodes less edges plus triangles less tetrahedra as a ball: one.
    let (nodes, tets) = (mesh.nodes.len(), mesh.tetrahedra.len());
    let boundary = mesh.surface().triangles.len();
    let triangles = (4 * tets + boundary) / 2;
    assert_eq!(quadratic.nodes.len() - nodes, nodes + triangles - tets - 1, "one mid-node per edge");
    assert_eq!((&quadratic.tetrahedra, &quadratic.regions), (&mesh.tetrahedra, &mesh.regions));
    assert_eq!(quadratic.region_names, mesh.region_names);
    for (corners, mids) in quadratic.tetrahedra.iter().zip(&quadratic.mid_nodes) {
        for ((a, b), mid) in EDGES.iter().zip(mids) {
            let [a, b, mid] = [corners[*a], corners[*b], *mid].map(|i| quadratic.nodes[i as usize]);
            assert_eq!(mid, (a + b) * 0.5);
        }
    }
    assert_eq!(quadratic.node_sets["bottom"], nodes_where(&quadratic, |x| x.z < 1e-9));
    assert_eq!(quadratic.promoted(), quadratic, "nothing to add");
    let back = quadratic.linear();
    assert_eq!(back, mesh);
}

#[test]
fn the_surface_of_a_quadratic_mesh_is_closed_and_holds_its_volume() {
    let mesh = linear();
    let quadratic = mesh.promoted();
    let (coarse, fine) = (mesh.surface(), quadratic.surface());
    assert_eq!(fine.triangles.len(), 4 * coarse.triangles.len());
    assert_eq!(fine.tetrahedra.len(), fine.triangles.len());
    assert!(fine.topology().closed && fine.topology().euler_characteristic == 2);
    let volume = mesh.volume();
    assert!((fine.enclosed_volume(&quadratic.nodes) - volume).abs() < 1e-14 * volume.max(1.0));
    // Facets turn as their faces do.
    for k in 0..fine.triangles.len() {
        let face = coarse.area_vector(k / 4, &mesh.nodes);
        let facet = fine.area_vector(k, &quadratic.nodes);
        assert!((facet * 4.0 - face).norm() < 1e-12 * face.norm(), "facet {k}");
        assert_eq!(fine.tetrahedra[k], coarse.tetrahedra[k / 4]);
    }
    // A ball: curved faces come four times nearer than flat ones of the same corners.
    let mut ball = block([4; 3], [2.0; 3], 0.0);
    let on_ball = |x: &Vector3<f64>| {
        let x = x - Vector3::repeat(1.0);
        if x.norm() == 0.0 { x } else { x * (x.amax() / x.norm()) }
    };
    ball.nodes.iter_mut().for_each(|x| *x = on_ball(x));
    let mut curved = ball.promoted();
    for &i in &curved.surface().nodes {
        curved.nodes[i as usize] = curved.nodes[i as usize].normalize();
    }
    let exact = 4.0 / 3.0 * std::f64::consts::PI;
    let missing = |mesh: &TetMesh| exact - mesh.surface().enclosed_volume(&mesh.nodes);
    let ratio = missing(&ball) / missing(&curved);
    assert!((3.6..4.4).contains(&ratio), "{ratio}");
}

#[test]
fn quadratic_meshes_come_back_from_files_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut mesh = linear().promoted();
    // Curved.
    let corners = mesh.linear().nodes.len();
    for (k, x) in mesh.nodes.iter_mut().enumerate().skip(corners) {
        *x += Vector3::new(1.0, -1.0, 0.5) * (1e-4 * (k % 3) as f64);
    }
    let (vtu, msh) = (folder.path().join("q.vtu"), folder.path().join("q.msh"));
    write_vtu(&vtu, &mesh, &[]).unwrap();
    write_msh(&msh, &mesh).unwrap();
    for path in [vtu, msh] {
        let file = read(&path).unwrap();
        assert!(file.warnings.is_empty(), "{:?}", file.warnings);
        assert_eq!(file.mesh, mesh, "{}", path.display());
    }
}

/// One quadratic tetrahedron as Gmsh and VTK write it: they number the last two mid-nodes in opposite ways.
#[test]
fn gmsh_and_vtk_number_mid_nodes_each_in_its_own_way() {
    let nodes = "0 0 0  2 0 0  0 2 0  0 0 2  1 0 0  1 1 0  0 1 0  0 0 1  1 0 1  0 1 1";
    let vtk = format!(
        "# vtk DataFile Version 3.0\none\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 10 double\n{nodes}\n\
         CELLS 1 11\n10 0 1 2 3 4 5 6 7 8 9\nCELL_TYPES 1\n24\n"
    );
    let numbered: Vec<String> = nodes.split("  ").enumerate().map(|(k, x)| format!("{} {x}", k + 1)).collect();
    let msh = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n10\n{}\n$EndNodes\n$Elements\n1\n\
         1 11 2 1 1 1 2 3 4 5 6 7 8 10 9\n$EndElements\n",
        numbered.join("\n")
    );
    let read = |name: &str, text: &str| {
        let file = inspect_bytes(Path::new(name), text.as_bytes()).unwrap();
        assert!(file.refusal.is_none(), "{name}: {:?}", file.refusal);
        file.mesh
    };
    let (from_vtk, from_msh) = (read("one.vtk", &vtk), read("one.msh", &msh));
    assert_eq!(from_vtk.mid_nodes, vec![[4, 5, 6, 7, 8, 9]]);
    assert_eq!(from_vtk.mid_nodes, from_msh.mid_nodes);
    assert_eq!(from_vtk.nodes, from_msh.nodes);
    // The other way round, mid-nodes lie across: refused, with the line.
    let wrong = msh.replace("10 9\n", "9 10\n");
    let refusal = inspect_bytes(Path::new("one.msh"), wrong.as_bytes()).unwrap().refusal.unwrap();
    let text = refusal.to_string();
    assert!(text.contains("one.msh:19") && text.contains("tetrahedron 0") && text.contains("order"), "{text}");
    // Turned inside out: all are, so they are turned round, mid-nodes with them.
    let inside_out = vtk.replace("10 0 1 2 3 4 5 6 7 8 9", "10 0 1 3 2 4 8 7 6 5 9");
    let turned = read("one.vtk", &inside_out);
    assert_eq!((turned.tetrahedra, turned.mid_nodes), (from_vtk.tetrahedra, from_vtk.mid_nodes));
}

#[test]
fn misplaced_mid_nodes_are_refused_with_their_element() {
    let refused = |change: &dyn Fn(&mut TetMesh)| {
        let mut mesh = linear().promoted();
        change(&mut mesh);
        let config = FemConfig { element: ElementKind::Quadratic, ..FemConfig::default() };
        (mesh.validate().unwrap_err(), FemModel::new(&mesh, &config).map(|_| ()))
    };
    let (error, model) = refused(&|mesh| {
        let (a, b) = (mesh.mid_nodes[5][0] as usize, mesh.tetrahedra[5][2] as usize);
        mesh.nodes[a] = mesh.nodes[b];
    });
    assert!(matches!(error, MeshError::MidNode { .. }) && error.to_string().contains("edge lengths"), "{error}");
    assert!(matches!(model, Err(FemError::MidNode { .. })));
    // Within reach of the edge, but the element folds at its corner: the mid-node is beyond a quarter of the edge.
    let (error, model) = refused(&|mesh| {
        let (mid, end) = (mesh.mid_nodes[5][3] as usize, mesh.tetrahedra[5][3] as usize);
        mesh.nodes[mid] = mesh.nodes[mid] * 0.4 + mesh.nodes[end] * 0.6;
    });
    assert!(error.to_string().contains("folds"), "{error}");
    assert!(matches!(model, Err(FemError::MidNode { .. })));
    let (error, _) = refused(&|mesh| mesh.mid_nodes[7][1] = mesh.mid_nodes[8][0]);
    assert!(matches!(error, MeshError::MidNodeShared { .. }), "{error}");
    let (error, model) = refused(&|mesh| {
        mesh.mid_nodes.pop();
    });
    assert!(matches!(error, MeshError::Inconsistent { .. }), "{error}");
    assert!(matches!(model, Err(FemError::MidNodeCount { .. })));
    let (error, model) = refused(&|mesh| mesh.mid_nodes[3][2] = 4000);
    assert!(matches!(error, MeshError::NodeOutOfRange { node: 4000, .. }), "{error}");
    assert!(matches!(model, Err(FemError::NodeOutOfRange { tetrahedron: 3, node: 4000, .. })));
}

#[test]
fn elements_and_meshes_of_different_order_are_refused_with_the_remedy() {
    let config = |element| FemConfig { element, ..FemConfig::default() };
    let error = FemModel::new(&linear(), &config(ElementKind::Quadratic)).unwrap_err();
    assert!(error.to_string().contains("TetMesh::promoted"), "{error}");
    let error = FemModel::new(&linear().promoted(), &config(ElementKind::Linear)).unwrap_err();
    assert!(error.to_string().contains("TetMesh::linear"), "{error}");
    let law = palpate_fem::material::Corotational { young: 5e3, poisson: 0.49 };
    let corotational = FemConfig { material: law.into(), ..config(ElementKind::Averaged) };
    let error = FemModel::new(&linear(), &corotational).unwrap_err();
    assert_eq!(error, FemError::NoBulk { law: "corotational" });
    assert!(error.to_string().contains("quadratic elements"), "{error}");
}
