//! Messages of the deforming bodies: the skin as triangles, all nodes as points.

use foxglove::messages::{
    PackedElementField, Point3, PointCloud, SceneEntity, SceneUpdate, TriangleListPrimitive,
    packed_element_field::NumericType,
};

use crate::geometry::BodyGeometry;
use crate::scene_message::{WORLD, color, identity, timestamp};

/// The messages of the deforming bodies: built once, their points overwritten at each writing.
pub(crate) struct TissueMessages {
    pub(crate) surface: SceneUpdate,
    pub(crate) nodes: PointCloud,
    /// Per body: the nodes on its surface, by index into all nodes.
    surface_nodes: Vec<Vec<usize>>,
    rest_positions: Vec<[f64; 3]>,
    /// Nodes of the first body.
    first_nodes: usize,
}

impl TissueMessages {
    pub(crate) fn new(bodies: &[BodyGeometry]) -> Self {
        let mut entities = Vec::new();
        let mut surface_nodes = Vec::new();
        let mut rest_positions: Vec<[f64; 3]> = Vec::new();
        for body in bodies {
            let (nodes, indices) = compact_surface(&body.triangles, body.rest_positions.len());
            entities.push(SceneEntity {
                frame_id: WORLD.into(),
                id: body.name.clone(),
                triangles: vec![TriangleListPrimitive {
                    pose: Some(identity()),
                    points: vec![Point3::default(); nodes.len()],
                    color: Some(color(body.color)),
                    colors: Vec::new(),
                    indices,
                }],
                ..SceneEntity::default()
            });
            surface_nodes.push(nodes.iter().map(|node| node + rest_positions.len()).collect());
            rest_positions.extend_from_slice(&body.rest_positions);
        }
        let field = |(k, name): (u32, &str)| PackedElementField {
            name: name.into(),
            offset: 4 * k,
            r#type: NumericType::Float32 as i32,
        };
        let nodes = PointCloud {
            frame_id: WORLD.into(),
            pose: Some(identity()),
            point_stride: 16,
            fields: [(0, "x"), (1, "y"), (2, "z"), (3, "displacement")].map(field).to_vec(),
            ..PointCloud::default()
        };
        let first_nodes = bodies.first().map_or(0, |body| body.rest_positions.len());
        let surface = SceneUpdate { deletions: Vec::new(), entities };
        Self { surface, nodes, surface_nodes, rest_positions, first_nodes }
    }

    /// Draws the first body with another skin from now on.
    pub(crate) fn change_skin(&mut self, triangles: &[[u32; 3]]) {
        let known = |t: &&[u32; 3]| t.iter().all(|&node| (node as usize) < self.first_nodes);
        let triangles: Vec<_> = triangles.iter().filter(known).copied().collect();
        let (nodes, indices) = compact_surface(&triangles, self.first_nodes);
        let first = self.surface.entities.first_mut().and_then(|entity| entity.triangles.first_mut());
        if let (Some(primitive), Some(of_first)) = (first, self.surface_nodes.first_mut()) {
            primitive.points = vec![Point3::default(); nodes.len()];
            primitive.indices = indices;
            *of_first = nodes;
        }
    }

    /// Takes over the positions of all nodes (m), `x, y, z` of each; missing ones stay as they were.
    pub(crate) fn update(&mut self, positions: &[f64], unix_ns: u64) {
        let (positions, _) = positions.as_chunks::<3>();
        for (entity, nodes) in self.surface.entities.iter_mut().zip(&self.surface_nodes) {
            entity.timestamp = Some(timestamp(unix_ns));
            let points = entity.triangles.iter_mut().flat_map(|primitive| &mut primitive.points);
            for (point, &node) in points.zip(nodes) {
                if let Some(&[x, y, z]) = positions.get(node) {
                    *point = Point3 { x, y, z };
                }
            }
        }
        let mut data = Vec::with_capacity(16 * self.rest_positions.len());
        for (position, rest) in positions.iter().zip(&self.rest_positions) {
            let squares: f64 = position.iter().zip(rest).map(|(now, then)| (now - then) * (now - then)).sum();
            for value in position.iter().chain([&squares.sqrt()]) {
                data.extend_from_slice(&(*value as f32).to_le_bytes());
            }
        }
        self.nodes.timestamp = Some(timestamp(unix_ns));
        self.nodes.data = data.into();
    }
}

/// The nodes that triangles use, in order of first use, and the triangles by position in that list.
fn compact_surface(triangles: &[[u32; 3]], nodes_of_body: usize) -> (Vec<usize>, Vec<u32>) {
    const UNUSED: u32 = u32::MAX;
    let mut place = vec![UNUSED; nodes_of_body];
    let mut nodes = Vec::new();
    let mut indices = Vec::with_capacity(3 * triangles.len());
    for &node in triangles.iter().flatten() {
        let place = &mut place[node as usize];
        if *place == UNUSED {
            *place = nodes.len() as u32;
            nodes.push(node as usize);
        }
        indices.push(*place);
    }
    (nodes, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_that_was_cut_is_drawn_with_its_new_skin_at_the_places_of_its_nodes() {
        let rest: Vec<[f64; 3]> = (0..5).map(|k| [f64::from(k), 0.0, 1.0]).collect();
        let other = BodyGeometry::new("other", vec![[9.0; 3]; 3], vec![[0, 1, 2]]);
        let body = BodyGeometry::new("body", rest.clone(), vec![[4, 1, 2], [2, 1, 3]]);
        let mut tissue = TissueMessages::new(&[body, other]);
        tissue.change_skin(&[[0, 3, 4], [3, 0, 9]]);
        let positions: Vec<f64> = rest.iter().flatten().map(|x| x + 10.0).chain([19.0; 9]).collect();
        tissue.update(&positions, 0);
        let drawn = &tissue.surface.entities[0].triangles[0];
        assert_eq!(drawn.indices, [0, 1, 2], "the triangle with a node that there is not is left out");
        let places: Vec<f64> = drawn.points.iter().map(|p| p.x).collect();
        assert_eq!(places, [10.0, 13.0, 14.0]);
        assert_eq!(tissue.surface.entities[1].triangles[0].points.len(), 3, "the other body keeps its skin");
        assert!(tissue.surface.entities[1].triangles[0].points.iter().all(|p| p.x == 19.0));
    }

    #[test]
    fn a_surface_keeps_only_its_own_nodes() {
        let rest = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [5.0; 3]];
        let body = BodyGeometry::new("body", rest, vec![[4, 1, 2], [2, 1, 3]]);
        assert_eq!(
            compact_surface(&body.triangles, body.rest_positions.len()),
            (vec![4, 1, 2, 3], vec![0, 1, 2, 2, 1, 3])
        );
    }
}
