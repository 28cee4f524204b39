//! What is written is read back to the bit.

use std::collections::BTreeMap;

use crate::format_samples::cube;
use nalgebra::Vector3;
use palpate_fem::format::{MeshFile, PointData, inspect, read, write_msh, write_vtu};
use palpate_fem::mesh::{MeshError, MeshWarning, TetMesh};
use proptest::prelude::*;

/// Meshes with odd coordinates, several regions of any name, and sets, that are valid in their lists and indices.
fn any_mesh() -> impl Strategy<Value = TetMesh> {
    let coordinate = prop_oneof![
        4 => -1.0..1.0_f64,
        1 => prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO,
    ];
    let nodes = prop::collection::vec(prop::array::uniform3(coordinate).prop_map(Vector3::from), 5..40);
    let names = prop::collection::btree_set("[a-zA-Z0-9&<>éµ][ a-zA-Z0-9_/.:<>&'é-]{0,8}[a-z]", 1..5);
    (nodes, names, prop::collection::vec(any::<[u16; 6]>(), 0..60)).prop_map(|(nodes, names, numbers)| {
        let count = nodes.len() as u32;
        // A chain of tetrahedra that uses every node, then random ones.
        let mut tetrahedra: Vec<[u32; 4]> = (0..count - 3).map(|i| [i, i + 1, i + 2, i + 3]).collect();
        tetrahedra.extend(numbers.iter().map(|n| [n[0], n[1], n[2], n[3]].map(|n| u32::from(n) % count)));
        let names: Vec<String> = names.into_iter().collect();
        let regions = (0..tetrahedra.len()).map(|t| (t * 7 % names.len()) as u16).collect();
        let mut node_sets = BTreeMap::new();
        for (k, name) in names.iter().enumerate() {
            let mut set: Vec<u32> = numbers.iter().map(|n| u32::from(n[4 + k % 2]) % count).collect();
            set.sort_unstable();
            set.dedup();
            if !set.is_empty() {
                node_sets.insert(format!("{name}!"), set);
            }
        }
        TetMesh { nodes, tetrahedra, regions, region_names: names, node_sets, ..TetMesh::default() }
    })
}

/// Equal to the bit, with -0 unlike 0.
fn same_bits(a: &TetMesh, b: &TetMesh) -> bool {
    let bits = |mesh: &TetMesh| -> Vec<u64> { mesh.nodes.iter().flatten().map(|value| value.to_bits()).collect() };
    a == b && bits(a) == bits(b)
}

/// What a file of this mesh is read as. Tetrahedra that are all inside out, and none of them flat, are turned round, which the
/// reader says.
fn as_read(mut mesh: TetMesh, file: &MeshFile) -> TetMesh {
    if file.warnings.iter().any(|warning| matches!(warning, MeshWarning::Reoriented { .. })) {
        let all = mesh.tetrahedra.len();
        assert_eq!(mesh.reorient(), all, "only a mesh that is wholly inside out is turned");
    }
    mesh
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_mesh_survives_vtu_and_msh_to_the_bit(mesh in any_mesh()) {
        let folder = tempfile::tempdir().unwrap();
        let (vtu, msh) = (folder.path().join("m.vtu"), folder.path().join("m.msh"));
        write_vtu(&vtu, &mesh, &[("displacement", PointData::Vectors(&mesh.nodes))]).unwrap();
        write_msh(&msh, &mesh).unwrap();
        for path in [&vtu, &msh] {
            let file = inspect(path).unwrap();
            let expected = as_read(mesh.clone(), &file);
            prop_assert!(same_bits(&file.mesh, &expected), "{:?}\n{expected:?}", file.mesh);
        }
    }
}

#[test]
fn a_region_without_tetrahedra_and_a_set_without_nodes_keep_their_names_in_vtu() {
    let mut mesh = cube();
    mesh.region_names.insert(0, "vessels".to_string());
    mesh.regions.iter_mut().for_each(|region| *region += 1);
    mesh.node_sets.insert("nothing".to_string(), Vec::new());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vtu");
    write_vtu(&path, &mesh, &[]).unwrap();
    assert_eq!(read(&path).unwrap().mesh, mesh);
}

#[test]
fn point_data_stand_in_the_file_as_they_were_given() {
    let mesh = cube();
    let pressure: Vec<f64> = (0..8).map(|node| 1.5 * f64::from(node)).collect();
    let velocity: Vec<Vector3<f64>> = mesh.nodes.iter().map(|x| 3.0 * x).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vtu");
    let data = [("pressure <Pa>", PointData::Scalars(&pressure)), ("velocity", PointData::Vectors(&velocity))];
    write_vtu(&path, &mesh, &data).unwrap();

    let bytes = std::fs::read(&path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    let start = bytes.windows(2).position(|pair| pair == b"\n_").unwrap() + 2;
    let array = |name: &str| -> Vec<f64> {
        let element = text.lines().find(|line| line.contains(&format!("Name=\"{name}\""))).unwrap();
        let offset: usize = element.split("offset=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
        let head = &bytes[start + offset..];
        let length = u64::from_le_bytes(head[..8].try_into().unwrap()) as usize;
        head[8..8 + length].chunks_exact(8).map(|value| f64::from_le_bytes(value.try_into().unwrap())).collect()
    };
    assert_eq!(array("pressure &lt;Pa&gt;"), pressure);
    assert_eq!(array("velocity"), velocity.iter().flatten().copied().collect::<Vec<f64>>());
}

#[test]
fn what_cannot_be_written_is_refused() {
    let mesh = cube();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vtu");
    let short = write_vtu(&path, &mesh, &[("p", PointData::Scalars(&[0.0; 7]))]).unwrap_err();
    assert!(short.to_string().contains("7 values of \"p\" for 8 nodes"), "{short}");
    let mut named = mesh.clone();
    named.region_names[0] = "a\0b".to_string();
    assert!(matches!(write_vtu(&path, &named, &[]), Err(MeshError::Inconsistent { .. })));
    named.region_names[0] = "a \"quoted\" name".to_string();
    assert!(matches!(write_msh(&path, &named), Err(MeshError::Inconsistent { .. })));
    let missing = folder.path().join("no/such/folder/m.vtu");
    assert!(matches!(write_vtu(&missing, &mesh, &[]), Err(MeshError::Io { .. })));
}
