//! Rectangular blocks of tetrahedra, for scenes that need no organ and for tests with closed forms.

use nalgebra::Vector3;

use crate::mesh::TetMesh;

/// The six tetrahedra of a cell (Kuhn 1960), as corners numbered by their bits: 1 for x, 2 for y, 4 for z.
///
/// All share the cell's diagonal 0-7, so neighbouring cells match without alternating.
const KUHN: [[usize; 4]; 6] = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// A block whose nodes lie at all combinations of the given ascending coordinates (m).
///
/// One region, `block`; node sets `x_min`, `x_max`, `y_min`, `y_max`, `z_min`, `z_max`. Nodes are numbered with x
/// fastest. Fewer than two coordinates on an axis give an empty mesh.
pub fn block(x: &[f64], y: &[f64], z: &[f64]) -> TetMesh {
    let counts = [x.len(), y.len(), z.len()];
    if counts.iter().any(|&n| n < 2) {
        return TetMesh::default();
    }
    let mut mesh = TetMesh { region_names: vec!["block".into()], ..TetMesh::default() };
    for &z in z {
        for &y in y {
            mesh.nodes.extend(x.iter().map(|&x| Vector3::new(x, y, z)));
        }
    }
    let index = |i: usize, j: usize, k: usize| (i + counts[0] * (j + counts[1] * k)) as u32;
    for k in 0..counts[2] - 1 {
        for j in 0..counts[1] - 1 {
            for i in 0..counts[0] - 1 {
                for corners in KUHN {
                    let node = |c: usize| index(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2));
                    mesh.tetrahedra.push(corners.map(node));
                }
            }
        }
    }
    mesh.regions = vec![0; mesh.tetrahedra.len()];
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        let of_face = |at: usize| -> Vec<u32> {
            let strides = [1, counts[0], counts[0] * counts[1]];
            (0..mesh.nodes.len()).filter(|n| n / strides[axis] % counts[axis] == at).map(|n| n as u32).collect()
        };
        let (low, high) = (of_face(0), of_face(counts[axis] - 1));
        mesh.node_sets.insert(format!("{name}_min"), low);
        mesh.node_sets.insert(format!("{name}_max"), high);
    }
    mesh
}

/// `cells + 1` coordinates at equal distances from `from` to `to` (m).
pub fn evenly(from: f64, to: f64, cells: usize) -> Vec<f64> {
    (0..=cells).map(|k| from + (to - from) * k as f64 / cells as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_filled_by_positive_tetrahedra() {
        let mesh = block(&evenly(-1.0, 1.0, 3), &[0.0, 0.5, 2.0], &evenly(0.0, 1.0, 2));
        let volume: f64 = mesh
            .tetrahedra
            .iter()
            .map(|t| {
                let [a, b, c, d] = t.map(|n| mesh.nodes[n as usize]);
                let v = (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0;
                assert!(v > 0.0);
                v
            })
            .sum();
        assert!((volume - 4.0).abs() < 1e-12, "a box of 2 x 2 x 1 holds {volume}");
        assert_eq!(mesh.node_sets["z_max"].len(), 12);
        assert!(mesh.node_sets["y_min"].iter().all(|&n| mesh.nodes[n as usize].y == 0.0));
    }
}
