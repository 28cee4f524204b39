//! How often tissue winds round the inner edges of its mesh.
//!
//! Round an inner edge the elements close a ring. The dihedral angles at the edge, negative in elements that are inside out,
//! sum to `2π w` with a whole number `w`, which is 1 at rest and changes only where an element of the ring becomes flat. Where
//! every element is open (`J > 0`) and `w = 1` at every inner edge, no tissue lies upon its neighbours: the elements round an
//! inner node then cover the directions round it without branching, and so once. At `w = 2` the ring goes round twice: tissue
//! has passed through itself, no element is inside out, and as a law sees elements only, it balances such a tangle like any
//! other shape. Tissue that meets itself from afar, skin upon skin, winds round no edge and is not found.
//!
//! The angles of quadratic elements are those at the mid-node of the edge, between the tangent planes of their faces. Between
//! curved elements they need not close to the last digit, so that `w` is rounded.

#![allow(non_snake_case)]

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::{
    element::{ElementKind, quadratic::EDGES},
    model::FemModel,
};

/// The other two corners for each of [`EDGES`], so that all four are an even permutation.
const OPPOSITE: [(usize, usize); 6] = [(2, 3), (0, 3), (3, 1), (1, 2), (2, 0), (0, 1)];

/// Edges that are wound otherwise than at rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TangleReport {
    /// Their number.
    pub edges: u32,
    /// How often the tissue winds round the worst of them, where once is how it should be: 2 where it went through itself, 0
    /// or less beside elements that are inside out.
    pub winding: i32,
    /// A tetrahedron of the mesh at that edge; `u32::MAX` where none is wound.
    pub tetrahedron: u32,
}

impl TangleReport {
    /// Not looked for, or nothing found.
    pub const NONE: Self = Self { edges: 0, winding: 1, tetrahedron: u32::MAX };
}

/// The edges of a body, and scratch to sum the angles round them.
#[derive(Clone, Debug)]
pub struct Windings {
    /// Edges of each element, in the order of [`EDGES`].
    edges_of: Vec<[u32; 6]>,
    /// `w` of each inner edge at rest, 0 of edges in the skin.
    at_rest: Vec<i32>,
    /// Sum of the angles round each edge.
    angles: Vec<f64>,
}

impl Windings {
    /// Memory for a body: 24 bytes an element and 12 an edge.
    pub fn new(model: &FemModel) -> Self {
        let pair = |nodes: &[u32; 4], (a, b): (usize, usize)| (nodes[a].min(nodes[b]), nodes[a].max(nodes[b]));
        let mut edges: Vec<(u32, u32)> =
            model.elements().iter().flat_map(|e| EDGES.map(|edge| pair(&e.nodes, edge))).collect();
        edges.sort_unstable();
        edges.dedup();
        // The elements round an edge lead from node to node: in a ring every node is left as often as it is reached.
        let mut ends = vec![[0_i128; 2]; edges.len()];
        let mut edges_of = Vec::with_capacity(model.elements().len());
        for element in model.elements() {
            let nodes = &element.nodes;
            edges_of.push(std::array::from_fn(|k| {
                let number = edges.partition_point(|edge| *edge < pair(nodes, EDGES[k]));
                let (from, to) = OPPOSITE[k];
                let along = if nodes[EDGES[k].0] < nodes[EDGES[k].1] { 1 } else { -1 };
                let (from, to) = (i128::from(nodes[from]), i128::from(nodes[to]));
                if let Some(end) = ends.get_mut(number) {
                    *end = [end[0] + along * (to - from), end[1] + along * (to * to - from * from)];
                }
                number as u32
            }));
        }
        let mut windings = Self { edges_of, at_rest: Vec::new(), angles: vec![0.0; edges.len()] };
        windings.sum_angles(model, model.q_rest());
        windings.at_rest =
            ends.iter().enumerate().map(|(k, end)| if *end == [0, 0] { windings.winding(k) } else { 0 }).collect();
        windings
    }

    /// Counts the inner edges that tissue with node positions `q` (m) does not wind round as at rest, once. Positions that are no numbers
    /// wind round nothing. Allocates nothing; in one order, and so with the same answer on any number of threads.
    pub fn find(&mut self, model: &FemModel, q: &[Vector3<f64>]) -> TangleReport {
        self.sum_angles(model, q);
        self.count(model)
    }

    fn sum_angles(&mut self, model: &FemModel, q: &[Vector3<f64>]) {
        self.angles.fill(0.0);
        let mut add = |edges: &[u32; 6], angle: &dyn Fn(usize) -> f64| {
            for (k, &edge) in edges.iter().enumerate() {
                if let Some(sum) = self.angles.get_mut(edge as usize) {
                    *sum += angle(k);
                }
            }
        };
        if model.element_kind() == ElementKind::Quadratic {
            let corners = model.elements().iter().zip(model.quadratic_elements());
            for (edges, (straight, element)) in self.edges_of.iter().zip(corners) {
                let gradients = element.nodal_gradients(q);
                let rest = straight.nodes.map(|n| model.q_rest()[n as usize]);
                add(edges, &|k| {
                    let F = &gradients[4 + k];
                    dihedral_angle(k, &rest.map(|x| F * (x - rest[EDGES[k].0])))
                });
            }
        } else {
            for (edges, element) in self.edges_of.iter().zip(model.elements()) {
                let corners = element.nodes.map(|n| q[n as usize]);
                add(edges, &|k| dihedral_angle(k, &corners));
            }
        }
    }

    /// `w` of an edge; 0 where the sum is not a number.
    fn winding(&self, edge: usize) -> i32 {
        self.angles.get(edge).map_or(0, |angle| (angle / TAU).round() as i32)
    }

    fn count(&self, model: &FemModel) -> TangleReport {
        let turns = |(edge, &at_rest): (usize, &i32)| if at_rest == 0 { 0 } else { self.winding(edge) - at_rest };
        let edges = self.at_rest.iter().enumerate().filter(|edge| turns(*edge) != 0).count() as u32;
        let mut report = TangleReport { edges, ..TangleReport::NONE };
        if edges == 0 {
            return report;
        }
        let mut worst = 0;
        for (edges, &tetrahedron) in self.edges_of.iter().zip(model.mesh_tetrahedron()) {
            for edge in edges.map(|edge| edge as usize) {
                let turns = self.at_rest.get(edge).map_or(0, |at_rest| turns((edge, at_rest)).abs());
                if turns > worst {
                    worst = turns;
                    (report.winding, report.tetrahedron) = (self.winding(edge), tetrahedron);
                }
            }
        }
        report
    }
}

/// Signed angle between the faces that meet at edge `k` of a tetrahedron with these corners.
fn dihedral_angle(k: usize, corners: &[Vector3<f64>; 4]) -> f64 {
    let ((a, b), (c, d)) = (EDGES[k], OPPOSITE[k]);
    let [edge, to, from] = [b, d, c].map(|i| corners[i] - corners[a]);
    let along = edge.norm_squared();
    let sine = along.sqrt() * edge.dot(&from.cross(&to));
    sine.atan2(along * from.dot(&to) - edge.dot(&from) * edge.dot(&to))
}
