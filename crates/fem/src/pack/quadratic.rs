//! Quadratic tetrahedra in packs of eight.

use nalgebra::Vector3;
use pulp::Arch;

use super::{
    DeformedPack, PACK, Pack, PackMatrices, QuadraticPackMatrices, Row,
    points::{Blocks, EdgesAtPoints, Forces},
};
use crate::{
    element::{QuadraticTetrahedron, Tetrahedron, UNIT, quadratic::POINTS},
    material::kernel::Dispatch,
};

/// What a law answers at the points of quadrature, as linear elements.
pub type PointMatrices = [PackMatrices; POINTS];

/// Rest shapes of up to eight quadratic tetrahedra. Places without an element repeat the last one.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticPack {
    /// Mesh nodes of each element: four corners, then six mid-nodes in VTK's order.
    pub nodes: [[u32; 10]; PACK],
    /// Number of elements, 1 to 8.
    pub len: usize,
    pub(super) shape: Shape,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// The shape of all points, with their weight (a quarter of the volume each).
    Straight(Box<Pack>),
    Curved(Box<Curved>),
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Curved {
    /// Unit shapes with the weights of the points.
    points: [Pack; POINTS],
    /// Components of the gradients of nodes 1 to 9 at the points (1/m).
    pub(super) gradients: [[[Row; 3]; 9]; POINTS],
}

impl QuadraticPack {
    /// Packs up to eight elements, which are computed as straight ones where all are; `corners` are the linear tetrahedra
    /// over their corners. `None` where there is none, or more, or another number of `corners`.
    pub fn new(elements: &[QuadraticTetrahedron], corners: &[Tetrahedron]) -> Option<Self> {
        let last = elements.last()?;
        if elements.len() != corners.len() || elements.len() > PACK {
            return None;
        }
        let of_lane = |lane: usize| elements.get(lane).unwrap_or(last);
        let nodes: [[u32; 10]; PACK] = std::array::from_fn(|lane| of_lane(lane).nodes);
        let shape = if elements.iter().all(QuadraticTetrahedron::is_straight) {
            // Points of quadrature are numbered like the corners, and what viscous tissue remembers like the points.
            let pack = Pack::ordered(corners, |_| [0, 1, 2, 3])?;
            let volume = pack.volume;
            Shape::Straight(Box::new(pack.weighted(|lane| volume[lane] / POINTS as f64)))
        } else {
            let unit = Pack::new(&vec![UNIT; elements.len()])?;
            let points = std::array::from_fn(|k| unit.clone().weighted(|lane| of_lane(lane).weights[k]));
            let mut gradients = [[[[0.0; PACK]; 3]; 9]; POINTS];
            for lane in 0..PACK {
                for (k, gradients) in gradients.iter_mut().enumerate() {
                    for (rows, g) in gradients.iter_mut().zip(&of_lane(lane).gradients(k)[1..]) {
                        (0..3).for_each(|c| rows[c][lane] = g[c]);
                    }
                }
            }
            Shape::Curved(Box::new(Curved { points, gradients }))
        };
        Some(Self { nodes, len: elements.len(), shape })
    }

    /// Whether all elements have straight edges, which costs less.
    pub fn is_straight(&self) -> bool {
        matches!(self.shape, Shape::Straight(_))
    }

    /// The linear elements that stand for the points at nodal positions `q` (m).
    #[inline]
    pub fn at_points(&self, q: &[Vector3<f64>]) -> [DeformedPack<'_>; POINTS] {
        self.at_points_on(Arch::new(), q)
    }

    pub(super) fn at_points_on(&self, dispatch: impl Dispatch, q: &[Vector3<f64>]) -> [DeformedPack<'_>; POINTS] {
        let mut x = [[[0.0; PACK]; 3]; 10];
        for (lane, nodes) in self.nodes.iter().enumerate() {
            // From node 0, for the sake of rounding far from the origin.
            let origin = q[nodes[0] as usize];
            for (x, &node) in x.iter_mut().zip(nodes) {
                let edge = q[node as usize] - origin;
                (0..3).for_each(|c| x[c][lane] = edge[c]);
            }
        }
        let mut edges = [[[[0.0; PACK]; 3]; 3]; POINTS];
        dispatch.run(EdgesAtPoints { pack: self, x: &x, edges: &mut edges });
        let mut edges = edges.into_iter();
        std::array::from_fn(|k| {
            let rest = match &self.shape {
                Shape::Straight(pack) => pack,
                Shape::Curved(curved) => &curved.points[k],
            };
            DeformedPack { rest, edges: edges.next().unwrap_or_default(), pressure: None }
        })
    }

    /// Forces and stiffness of the elements from those at their points.
    #[inline]
    pub fn sum_points(&self, points: &PointMatrices, out: &mut QuadraticPackMatrices) {
        self.sum_points_on(Arch::new(), points, out);
    }

    pub(super) fn sum_points_on(
        &self,
        dispatch: impl Dispatch,
        points: &PointMatrices,
        out: &mut QuadraticPackMatrices,
    ) {
        self.sum_forces_on(dispatch, points, out);
        for c in 0..3 {
            for r in c..3 {
                dispatch.run(Blocks { pack: self, points, r, c, out });
            }
        }
    }

    /// Forces of the elements alone from those at their points.
    #[inline]
    pub fn sum_forces(&self, points: &PointMatrices, out: &mut QuadraticPackMatrices) {
        self.sum_forces_on(Arch::new(), points, out);
    }

    fn sum_forces_on(&self, dispatch: impl Dispatch, points: &PointMatrices, out: &mut QuadraticPackMatrices) {
        dispatch.run(Forces { pack: self, points, out });
        for lane in 0..PACK {
            out.jacobian[lane] = points.iter().map(|p| p.jacobian[lane]).fold(f64::INFINITY, f64::min);
            out.filtered[lane] = points.iter().map(|p| p.filtered[lane]).fold(0.0, f64::max);
            out.checksum[lane] = points.iter().map(|p| p.checksum[lane]).sum();
        }
    }
}
