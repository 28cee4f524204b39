//! The boundary of a mesh is closed, points outwards, and encloses the volume of the tetrahedra.

use nalgebra::{Rotation3, Vector3};
use palpate_fem::mesh::TetMesh;
use proptest::prelude::*;

/// A box of n cells per side in six tetrahedra each, without the cells for which `hole` holds.
fn box_mesh(n: [u32; 3], size: Vector3<f64>, hole: impl Fn([u32; 3]) -> bool) -> TetMesh {
    let node = |i: [u32; 3]| i[0] + (n[0] + 1) * (i[1] + (n[1] + 1) * i[2]);
    let mut mesh = TetMesh { region_names: vec!["body".to_string()], ..TetMesh::default() };
    for k in 0..=n[2] {
        for j in 0..=n[1] {
            for i in 0..=n[0] {
                let unit = Vector3::new(i, j, k).map(f64::from);
                mesh.nodes.push(Vector3::from_fn(|axis, _| size[axis] * unit[axis] / f64::from(n[axis])));
            }
        }
    }
    let cells = (0..n[2]).flat_map(|k| (0..n[1]).flat_map(move |j| (0..n[0]).map(move |i| [i, j, k])));
    for cell in cells.filter(|&cell| !hole(cell)) {
        for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]] {
            let mut corner = cell;
            let mut path = [node(corner); 4];
            for (step, axis) in order.into_iter().enumerate() {
                corner[axis] += 1;
                path[step + 1] = node(corner);
            }
            mesh.tetrahedra.push(path);
        }
    }
    mesh.regions = vec![0; mesh.tetrahedra.len()];
    mesh.reorient();
    mesh.drop_unused_nodes();
    mesh
}

fn solid(_: [u32; 3]) -> bool {
    false
}

#[test]
fn surface_of_a_box_has_its_area_and_points_outwards() {
    let size = Vector3::new(0.3, 0.2, 0.1);
    let mesh = box_mesh([3, 2, 4], size, solid);
    let surface = mesh.surface();
    // Two triangles per square of the six sides.
    assert_eq!(surface.triangles.len(), 2 * 2 * (3 * 2 + 3 * 4 + 2 * 4));
    let area = 2.0 * (size.x * size.y + size.x * size.z + size.y * size.z);
    // Sixty sums of numbers of order 1e-3: rounding stays below 1e-13 of the total.
    assert!((surface.area(&mesh.nodes) / area - 1.0).abs() < 1e-13);

    let centre = mesh.bounding_box().centre();
    for (k, (triangle, &t)) in surface.triangles.iter().zip(&surface.tetrahedra).enumerate() {
        let normal = surface.area_vector(k, &mesh.nodes);
        let middle = triangle.iter().map(|&node| mesh.nodes[node as usize]).sum::<Vector3<f64>>() / 3.0;
        assert!(normal.dot(&(middle - centre)) > 0.0, "triangle {k} points inwards");
        assert_eq!(normal.iter().filter(|component| **component != 0.0).count(), 1, "normal along an axis");
        assert!(triangle.iter().all(|node| mesh.tetrahedra[t as usize].contains(node)), "tetrahedron behind {k}");
    }
    let on_side = |x: &Vector3<f64>| (0..3).any(|axis| x[axis] == 0.0 || x[axis] == size[axis]);
    let expected: Vec<u32> = (0..).zip(&mesh.nodes).filter(|(_, x)| on_side(x)).map(|(node, _)| node).collect();
    assert_eq!(surface.nodes, expected);
}

#[test]
fn euler_characteristic_counts_handles_and_cavities() {
    let size = Vector3::repeat(1.0);
    let topology = |hole: fn([u32; 3]) -> bool| box_mesh([3, 3, 3], size, hole).surface().topology();
    let full = topology(solid);
    assert!(full.closed);
    assert_eq!((full.euler_characteristic, full.rim_edges, full.pinched_edges), (2, 0, 0));
    // A hole right through makes a torus; a cavity adds a sphere.
    let torus = topology(|[i, j, _]| [i, j] == [1, 1]);
    assert_eq!((torus.euler_characteristic, torus.closed), (0, true));
    let cavity = topology(|cell| cell == [1, 1, 1]);
    assert_eq!((cavity.euler_characteristic, cavity.closed), (4, true));
}

#[test]
fn parts_that_touch_along_an_edge_are_seen_and_a_cut_surface_has_a_rim() {
    // Two cells of four remain, across a common edge.
    let pinched = box_mesh([2, 2, 1], Vector3::repeat(1.0), |[i, j, _]| i != j);
    let topology = pinched.surface().topology();
    assert_eq!((topology.pinched_edges, topology.closed), (1, true));
    assert_eq!(pinched.validate().unwrap().parts, 1);

    let mut surface = box_mesh([1, 1, 1], Vector3::repeat(1.0), solid).surface();
    surface.triangles.pop();
    let topology = surface.topology();
    assert_eq!((topology.rim_edges, topology.closed), (3, false));
}

#[test]
fn faces_between_regions_are_inside() {
    let mut mesh = box_mesh([2, 1, 1], Vector3::repeat(1.0), solid);
    let whole = mesh.surface();
    mesh.region_names.push("lesion".to_string());
    mesh.regions[..6].fill(1);
    assert_eq!(mesh.surface(), whole);
    let quality = mesh.validate().unwrap();
    let volumes: Vec<f64> = quality.regions.iter().map(|region| region.volume).collect();
    assert!(volumes.iter().all(|volume| (volume - 0.5).abs() < 1e-15), "{volumes:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Divergence theorem on boxes with distorted inner and outer nodes, turned and far from the origin.
    #[test]
    fn surface_encloses_the_volume_of_the_tetrahedra(
        seed in any::<u64>(),
        angles in prop::array::uniform3(-3.0..3.0_f64),
        offset in prop::array::uniform3(-10.0..10.0_f64),
    ) {
        let mut mesh = box_mesh([3, 3, 3], Vector3::repeat(0.1), solid);
        let mut state = seed | 1;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let rotation = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]);
        for x in &mut mesh.nodes {
            // A fifth of a cell: no tetrahedron turns over.
            *x = rotation * (*x + Vector3::from_fn(|_, _| random()) * 0.2 / 30.0) + Vector3::from(offset);
        }
        let surface = mesh.surface();
        prop_assert!(mesh.validate().is_ok());
        prop_assert!(surface.topology().closed);
        // Coordinates of 10 m carry 2e-15 m of rounding; relative to cells of 0.03 m and in the volume, 1e-12.
        let (inside, enclosed) = (mesh.volume(), surface.enclosed_volume(&mesh.nodes));
        prop_assert!((enclosed / inside - 1.0).abs() < 1e-12, "{enclosed} {inside}");
    }

    /// The surface does not depend on how tetrahedra are ordered and which of their nodes comes first.
    #[test]
    fn surface_is_a_matter_of_the_mesh_and_not_of_its_order(turn in 0..12_usize, shift in 1..40_usize) {
        let mesh = box_mesh([2, 2, 2], Vector3::repeat(1.0), solid);
        let even: Vec<[usize; 4]> = even_permutations();
        let mut other = mesh.clone();
        for t in &mut other.tetrahedra {
            *t = even[turn].map(|i| t[i]);
        }
        other.tetrahedra.rotate_left(shift);
        let canonical = |mesh: &TetMesh| {
            let mut triangles = mesh.surface().triangles;
            for triangle in &mut triangles {
                let first = (0..3).min_by_key(|&i| triangle[i]).unwrap_or(0);
                triangle.rotate_left(first);
            }
            triangles.sort_unstable();
            triangles
        };
        prop_assert_eq!(canonical(&mesh), canonical(&other));
    }
}

/// Orders of four things that keep the sign of a volume.
fn even_permutations() -> Vec<[usize; 4]> {
    let mut even = Vec::new();
    for a in 0..4 {
        for b in (0..4).filter(|b| *b != a) {
            for c in (0..4).filter(|c| ![a, b].contains(c)) {
                let p = [a, b, c, 6 - a - b - c];
                let inversions = (0..4).flat_map(|i| (i + 1..4).map(move |j| (i, j))).filter(|&(i, j)| p[i] > p[j]);
                if inversions.count() % 2 == 0 {
                    even.push(p);
                }
            }
        }
    }
    even
}
