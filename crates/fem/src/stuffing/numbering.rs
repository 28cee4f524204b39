//! Nodes and tetrahedra in an order that keeps neighbours in space near in memory.

use nalgebra::Vector3;

use crate::mesh::TetMesh;

/// Numbers the nodes in use along a Morton curve and the tetrahedra by their lowest nodes, so that neighbours in
/// space are neighbours in memory.
pub(super) fn number_nodes(tetrahedra: &[[u32; 4]], position: &impl Fn(u32) -> Vector3<f64>, cell: f64) -> TetMesh {
    let mut keys: Vec<u32> = tetrahedra.iter().flatten().copied().collect();
    keys.sort_unstable();
    keys.dedup();
    let low = keys.iter().fold(Vector3::repeat(f64::INFINITY), |low, &key| low.inf(&position(key)));
    let mut order: Vec<(u64, u32)> =
        keys.iter().map(|&key| (morton((position(key) - low) * (4.0 / cell)), key)).collect();
    order.sort_unstable();
    let mut number = vec![0u32; keys.len()];
    for (n, (_, key)) in order.iter().enumerate() {
        if let Ok(i) = keys.binary_search(key) {
            number[i] = n as u32;
        }
    }
    let renumber = |key: u32| keys.binary_search(&key).map_or(0, |i| number[i]);
    let mut tetrahedra: Vec<[u32; 4]> = tetrahedra.iter().map(|t| t.map(renumber)).collect();
    tetrahedra.sort_by_key(|t| {
        let mut nodes = *t;
        nodes.sort_unstable();
        nodes
    });
    TetMesh {
        nodes: order.iter().map(|&(_, key)| position(key)).collect(),
        regions: vec![0; tetrahedra.len()],
        tetrahedra,
        region_names: vec!["body".to_owned()],
        ..TetMesh::default()
    }
}

/// Interleaves the bits of three coordinates (21 bits each).
fn morton(point: Vector3<f64>) -> u64 {
    let mut code = 0;
    for bit in (0..21).rev() {
        for axis in 0..3 {
            code = code << 1 | ((point[axis] as u64) >> bit & 1);
        }
    }
    code
}
