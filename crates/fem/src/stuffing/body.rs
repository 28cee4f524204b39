//! What hangs together: bodies connected through faces, and pinches of the boundary.

/// A tetrahedron's faces, each oriented outward for a positive tetrahedron.
pub(super) const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Body of each tetrahedron (connected through faces), numbered in the order of their first tetrahedron, and the
/// number of bodies.
pub(super) fn bodies(tetrahedra: &[[u32; 4]]) -> (Vec<u32>, usize) {
    let mut parent: Vec<u32> = (0..tetrahedra.len() as u32).collect();
    fn find(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for pair in sorted_faces(tetrahedra).windows(2) {
        if pair[0].0 == pair[1].0 {
            let (u, v) = (find(&mut parent, pair[0].1), find(&mut parent, pair[1].1));
            parent[u.max(v) as usize] = u.min(v);
        }
    }
    let mut count = 0;
    let mut number = vec![0; tetrahedra.len()];
    for t in 0..tetrahedra.len() {
        let root = find(&mut parent, t as u32) as usize;
        if root == t {
            number[t] = count;
            count += 1;
        } else {
            number[t] = number[root];
        }
    }
    (number, count as usize)
}

/// Triangles that belong to one tetrahedron only, oriented outward, in a fixed order.
pub(super) fn boundary(tetrahedra: &[[u32; 4]]) -> Vec<[u32; 3]> {
    let faces = sorted_faces(tetrahedra);
    let alone =
        |i: usize| (i == 0 || faces[i - 1].0 != faces[i].0) && (i + 1 == faces.len() || faces[i + 1].0 != faces[i].0);
    (0..faces.len())
        .filter(|&i| alone(i))
        .map(|i| FACES[faces[i].2].map(|corner| tetrahedra[faces[i].1 as usize][corner]))
        .collect()
}

/// Nodes where the boundary is not a surface: around them the triangles do not form a single closed fan.
pub(super) fn pinches(boundary: &[[u32; 3]]) -> Vec<u32> {
    // Around node n each triangle (n, p, q) is a step from p to q.
    let mut steps: Vec<(u32, u32, u32)> =
        boundary.iter().flat_map(|&[p, q, r]| [(p, q, r), (q, r, p), (r, p, q)]).collect();
    steps.sort_unstable();
    let mut pinched = Vec::new();
    for fan in steps.chunk_by(|s, t| s.0 == t.0) {
        let mut at = fan[0].1;
        let mut length = 0;
        while let Ok(i) = fan.binary_search_by_key(&at, |s| s.1) {
            at = fan[i].2;
            length += 1;
            if at == fan[0].1 || length > fan.len() {
                break;
            }
        }
        let branches = fan.windows(2).any(|pair| pair[0].1 == pair[1].1);
        if branches || length != fan.len() || at != fan[0].1 {
            pinched.push(fan[0].0);
        }
    }
    pinched
}

/// All faces as (sorted nodes, tetrahedron, face), sorted.
fn sorted_faces(tetrahedra: &[[u32; 4]]) -> Vec<([u32; 3], u32, usize)> {
    let mut faces = Vec::with_capacity(4 * tetrahedra.len());
    for (t, nodes) in tetrahedra.iter().enumerate() {
        for (f, corners) in FACES.iter().enumerate() {
            let mut face = corners.map(|c| nodes[c]);
            face.sort_unstable();
            faces.push((face, t as u32, f));
        }
    }
    faces.sort_unstable();
    faces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_joins_and_a_vertex_or_an_edge_does_not() {
        assert_eq!(bodies(&[[0, 1, 2, 3], [1, 2, 3, 4]]).1, 1);
        assert_eq!(bodies(&[[0, 1, 2, 3], [2, 3, 4, 5]]), (vec![0, 1], 2));
        assert_eq!(boundary(&[[0, 1, 2, 3], [4, 3, 2, 1]]).len(), 6);
    }

    #[test]
    fn shared_edges_and_vertices_are_pinches() {
        let pinched = |t: &[[u32; 4]]| pinches(&boundary(t));
        assert!(pinched(&[[0, 1, 2, 3], [4, 3, 2, 1]]).is_empty());
        assert_eq!(pinched(&[[0, 1, 2, 3], [3, 4, 5, 6]]), [3]);
        assert_eq!(pinched(&[[0, 1, 2, 3], [2, 3, 4, 5]]), [2, 3]);
    }
}
