//! Tetrahedra in packs of eight: rest shapes and results as rows of eight numbers, one for each element.
//!
//! A quadratic element is four linear ones, one for each point of quadrature ([`QuadraticPack`]): what a law answers to packs
//! serves every kind of element.
//!
//! The nodes of a packed element ascend, whatever their order in the mesh, so that its blocks `(a, b)` with `a <= b` all
//! lie in the upper half of the system and none is transposed on its way there. Half of the orders turn the sign of
//! `det E`, which cancels in every formula that holds [`Pack::inverse_det`].

#![allow(non_snake_case)]

mod curved;
mod points;
mod quadratic;
mod shares;
mod straight;

use nalgebra::{Matrix3, Vector3};

pub use self::{
    quadratic::{PointMatrices, QuadraticPack},
    shares::{PackMatrices, PackShares, QuadraticPackMatrices},
};
use crate::element::Tetrahedron;

/// Elements in a pack: the widest vectors hold eight numbers.
pub const PACK: usize = 8;

/// One number for each element of a pack.
pub type Row = [f64; PACK];

/// Deformed edges from the first node to the others (m): `edges[i][c]` is component `c` of `e_(i+1)`.
pub type Edges = [[Row; 3]; 3];

/// Rest shapes of up to eight tetrahedra. Places without an element repeat the last one.
#[repr(align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct Pack {
    /// Mesh nodes of each element, ascending unless the pack is part of one of quadratic elements.
    pub nodes: [[u32; 4]; PACK],
    /// Number of elements, 1 to 8.
    pub len: usize,
    /// Components of the shape vectors: `shape[i][c]` is component `c` of `D_(i+1)` (1/m).
    pub shape: [[Row; 3]; 3],
    /// `D_i · D_j` (1/m²) for the pairs 11, 12, 13, 22, 23, 33.
    pub gram: [Row; 6],
    /// `1 / det E`, plus or minus `1 / 6 V0` of the whole tetrahedron (1/m³).
    pub inverse_det: Row,
    /// Rest volume `V0` (m³), positive; at a point of quadrature its weight.
    pub volume: Row,
}

/// A pack of elements in space: what laws answer to.
#[derive(Clone, Debug)]
pub struct DeformedPack<'a> {
    /// Their rest shapes.
    pub rest: &'a Pack,
    /// Their edges.
    pub edges: Edges,
    /// Pressures `p` (Pa, positive in tension) under which the energy is `Ψ(F) + p J`; for laws that have an answer to
    /// [`Law::element_under_pressure`](crate::material::Law::element_under_pressure), others may ignore them.
    pub pressure: Option<&'a Row>,
}

impl DeformedPack<'_> {
    /// Edges of one element as columns (m).
    ///
    /// # Panics
    /// If `lane` is not below [`PACK`].
    pub fn edges_of(&self, lane: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|c, i| self.edges[i][c][lane])
    }
}

impl Pack {
    /// Packs up to eight elements; `None` where there is none or more.
    pub fn new(elements: &[Tetrahedron]) -> Option<Self> {
        Self::ordered(elements, |nodes| {
            let mut order = [0, 1, 2, 3];
            order.sort_by_key(|&a| nodes[a]);
            order
        })
    }

    /// [`Pack::new`] with the nodes of each element in the order that `order` gives.
    fn ordered(elements: &[Tetrahedron], order: impl Fn(&[u32; 4]) -> [usize; 4]) -> Option<Self> {
        let last = elements.last()?;
        if elements.len() > PACK {
            return None;
        }
        let mut pack = Self {
            nodes: [[0; 4]; PACK],
            len: elements.len(),
            shape: [[[0.0; PACK]; 3]; 3],
            gram: [[0.0; PACK]; 6],
            inverse_det: [0.0; PACK],
            volume: [0.0; PACK],
        };
        for lane in 0..PACK {
            let element = elements.get(lane).unwrap_or(last);
            let order = order(&element.nodes);
            pack.nodes[lane] = order.map(|a| element.nodes[a]);
            let D = element.shape_vectors();
            let D = [D[order[1]], D[order[2]], D[order[3]]];
            let mut k = 0;
            for i in 0..3 {
                for c in 0..3 {
                    pack.shape[i][c][lane] = D[i][c];
                }
                for j in i..3 {
                    pack.gram[k][lane] = D[i].dot(&D[j]);
                    k += 1;
                }
            }
            let even =
                (0..4).flat_map(|a| (0..a).map(move |b| (b, a))).filter(|&(b, a)| order[b] > order[a]).count() % 2;
            let sign = if even == 0 { 1.0 } else { -1.0 };
            pack.inverse_det[lane] = sign / (6.0 * element.volume);
            pack.volume[lane] = element.volume;
        }
        Some(pack)
    }

    /// An element with its nodes ascending. Where that turns the orientation, its edges have a negative determinant.
    ///
    /// # Panics
    /// If `lane` is not below [`PACK`].
    pub fn element(&self, lane: usize) -> Tetrahedron {
        Tetrahedron {
            nodes: self.nodes[lane],
            inverse_rest_edges: Matrix3::from_fn(|i, c| self.shape[i][c][lane]),
            volume: self.volume[lane],
        }
    }

    /// The same shapes with the weights of a point of quadrature (m³) for volumes.
    fn weighted(mut self, weight: impl Fn(usize) -> f64) -> Self {
        for lane in 0..PACK {
            self.volume[lane] = weight(lane.min(self.len - 1));
        }
        self
    }

    /// The pack at nodal positions `q` (m), under no pressure.
    #[inline]
    pub fn at(&self, q: &[Vector3<f64>]) -> DeformedPack<'_> {
        DeformedPack { rest: self, edges: self.edges(q), pressure: None }
    }

    /// Deformed edges from the first node to the others (m): `edges[i][c]` is component `c` of `e_(i+1)`.
    #[inline]
    pub fn edges(&self, q: &[Vector3<f64>]) -> Edges {
        let mut edges = [[[0.0; PACK]; 3]; 3];
        for (lane, nodes) in self.nodes.iter().enumerate() {
            let [a, b, c, d] = nodes.map(|i| q[i as usize]);
            for (i, edge) in [b - a, c - a, d - a].iter().enumerate() {
                for c in 0..3 {
                    edges[i][c][lane] = edge[c];
                }
            }
        }
        edges
    }
}
