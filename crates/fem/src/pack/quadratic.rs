//! Quadratic tetrahedra in packs of eight.

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

use super::{DeformedPack, Edges, PACK, Pack, PackMatrices, QuadraticPackMatrices, Row, curved, straight};
use crate::{
    element::{
        QuadraticTetrahedron, Tetrahedron, UNIT,
        quadratic::{EDGES, POINTS},
    },
    lanes::{Lanes, Real},
    material::kernel::{Dispatch, TRIANGLE},
};

/// What a law answers at the points of quadrature, as linear elements.
pub type PointMatrices = [PackMatrices; POINTS];

/// Rest shapes of up to eight quadratic tetrahedra. Places without an element repeat the last one.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticPack {
    /// Mesh nodes of each element: four corners, then six mid-nodes in VTK's order. Corners of elements with straight
    /// edges ascend.
    pub nodes: [[u32; 10]; PACK],
    /// Number of elements, 1 to 8.
    pub len: usize,
    shape: Shape,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    /// The shape of all points, with their weight (a quarter of the volume each).
    Straight(Box<Pack>),
    Curved(Box<Curved>),
}

#[derive(Clone, Debug, PartialEq)]
struct Curved {
    /// Unit shapes with the weights of the points.
    points: [Pack; POINTS],
    /// Components of the gradients of nodes 1 to 9 at the points (1/m).
    gradients: [[[Row; 3]; 9]; POINTS],
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
        let mut nodes: [[u32; 10]; PACK] = std::array::from_fn(|lane| of_lane(lane).nodes);
        let shape = if elements.iter().all(QuadraticTetrahedron::is_straight) {
            nodes = nodes.map(ascending_corners);
            let pack = Pack::new(corners)?;
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

    fn at_points_on(&self, dispatch: impl Dispatch, q: &[Vector3<f64>]) -> [DeformedPack<'_>; POINTS] {
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

    fn sum_points_on(&self, dispatch: impl Dispatch, points: &PointMatrices, out: &mut QuadraticPackMatrices) {
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

/// The same element with its corners ascending.
fn ascending_corners(nodes: [u32; 10]) -> [u32; 10] {
    let mut order = [0, 1, 2, 3];
    order.sort_by_key(|&a| nodes[a]);
    std::array::from_fn(|i| match i {
        0..4 => nodes[order[i]],
        _ => {
            let (a, b) = (order[EDGES[i - 4].0], order[EDGES[i - 4].1]);
            let edge = EDGES.iter().position(|&edge| edge == (a.min(b), a.max(b)));
            nodes[4 + edge.unwrap_or_default()]
        }
    })
}

/// Parts into which vectors of `S` cut the elements of a pack.
#[inline(always)]
fn parts<S: Simd>(pack: &QuadraticPack) -> usize {
    pack.len.min(PACK).div_ceil(Lanes::<S>::COUNT)
}

/// The gradients of one part of a pack.
#[inline(always)]
fn gradients<S: Simd>(simd: S, rows: &[[Row; 3]; 9], part: usize) -> curved::Gradients<Lanes<S>> {
    let mut gradients = [[Lanes::load(simd, &rows[0][0], part); 3]; 9];
    for i in 0..9 {
        for c in 0..3 {
            gradients[i][c] = Lanes::load(simd, &rows[i][c], part);
        }
    }
    gradients
}

struct EdgesAtPoints<'a> {
    pack: &'a QuadraticPack,
    /// Nodes from node 0 on (m).
    x: &'a [[Row; 3]; 10],
    edges: &'a mut [Edges; POINTS],
}

impl WithSimd for EdgesAtPoints<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { pack, x, edges } = self;
        for part in 0..parts::<S>(pack) {
            for c in 0..3 {
                let mut of_nodes = [Lanes::<S>::load(simd, &x[0][c], part); 10];
                for i in 1..10 {
                    of_nodes[i] = Lanes::load(simd, &x[i][c], part);
                }
                let at_points = match &pack.shape {
                    Shape::Straight(_) => straight::edges_at_points(&of_nodes),
                    Shape::Curved(shape) => {
                        let [_, x1, x2, x3, x4, x5, x6, x7, x8, x9] = of_nodes;
                        let from_first = [x1, x2, x3, x4, x5, x6, x7, x8, x9];
                        let mut at_points = [[x1; 3]; POINTS];
                        for k in 0..POINTS {
                            let g = gradients(simd, &shape.gradients[k], part);
                            at_points[k] = curved::edges_at_point(&from_first, &g);
                        }
                        at_points
                    }
                };
                for k in 0..POINTS {
                    for a in 0..3 {
                        at_points[k][a].store(&mut edges[k][a][c], part);
                    }
                }
            }
        }
    }
}

struct Forces<'a> {
    pack: &'a QuadraticPack,
    points: &'a PointMatrices,
    out: &'a mut QuadraticPackMatrices,
}

impl WithSimd for Forces<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { pack, points, out } = self;
        for part in 0..parts::<S>(pack) {
            for c in 0..3 {
                let mut at = [[Lanes::<S>::load(simd, &points[0].forces[0][c], part); 4]; POINTS];
                for k in 0..POINTS {
                    for a in 0..4 {
                        at[k][a] = Lanes::load(simd, &points[k].forces[a][c], part);
                    }
                }
                let nodes = match &pack.shape {
                    Shape::Straight(_) => straight::to_nodes(&at),
                    Shape::Curved(shape) => {
                        let mut nodes = [at[0][0].constant(0.0); 9];
                        for k in 0..POINTS {
                            let [_, f1, f2, f3] = at[k];
                            let g = gradients(simd, &shape.gradients[k], part);
                            curved::add_to_nodes(&[f1, f2, f3], &g, &mut nodes);
                        }
                        curved::complete(&nodes)
                    }
                };
                for i in 0..10 {
                    nodes[i].store(&mut out.forces[i][c], part);
                }
            }
        }
    }
}

/// Entries `(r, c)` and `(c, r)` of all blocks.
struct Blocks<'a> {
    pack: &'a QuadraticPack,
    points: &'a PointMatrices,
    r: usize,
    c: usize,
    out: &'a mut QuadraticPackMatrices,
}

impl WithSimd for Blocks<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { pack, points, r, c, out } = self;
        for part in 0..parts::<S>(pack) {
            match &pack.shape {
                Shape::Straight(_) => {
                    // By column, point and row.
                    let mut columns = [[[Lanes::<S>::load(simd, &points[0].jacobian, part); 4]; POINTS]; 10];
                    for k in 0..POINTS {
                        let rows = load_rows(simd, &points[k], r, c, part);
                        for a in 0..4 {
                            let of_row = straight::to_columns(&rows[a], k);
                            for j in 0..10 {
                                columns[j][k][a] = of_row[j];
                            }
                        }
                    }
                    for j in 0..10 {
                        store_column(&straight::to_nodes(&columns[j]), j, r, c, out, part);
                    }
                }
                Shape::Curved(shape) => {
                    let zero = Lanes::<S>::load(simd, &points[0].jacobian, part).constant(0.0);
                    let mut columns = [[zero; 9]; 9];
                    for k in 0..POINTS {
                        let rows = load_rows(simd, &points[k], r, c, part);
                        let g = gradients(simd, &shape.gradients[k], part);
                        let mut of_rows = [[zero; 9]; 3];
                        for a in 0..3 {
                            let [_, b1, b2, b3] = rows[a + 1];
                            of_rows[a] = curved::to_columns(&[b1, b2, b3], &g);
                        }
                        for j in 0..9 {
                            let at = [of_rows[0][j], of_rows[1][j], of_rows[2][j]];
                            curved::add_to_nodes(&at, &g, &mut columns[j]);
                        }
                    }
                    let mut first = [zero; 9];
                    for j in 0..9 {
                        for i in 0..9 {
                            first[i] = first[i] - columns[j][i];
                        }
                        store_column(&curved::complete(&columns[j]), j + 1, r, c, out, part);
                    }
                    store_column(&curved::complete(&first), 0, r, c, out, part);
                }
            }
        }
    }
}

/// Entry `(r, c)` of the blocks `K_ab` of the linear elements at a point, by `a` and `b`.
#[inline(always)]
fn load_rows<S: Simd>(simd: S, point: &PackMatrices, r: usize, c: usize, part: usize) -> [[Lanes<S>; 4]; 4] {
    let diagonal = TRIANGLE[r][c];
    let mut rows = [[Lanes::load(simd, &point.diagonal[0][diagonal], part); 4]; 4];
    let mut k = 0;
    for a in 0..4 {
        rows[a][a] = Lanes::load(simd, &point.diagonal[a][diagonal], part);
        for b in a + 1..4 {
            rows[a][b] = Lanes::load(simd, &point.off_diagonal[k][3 * c + r], part);
            rows[b][a] = Lanes::load(simd, &point.off_diagonal[k][3 * r + c], part);
            k += 1;
        }
    }
    rows
}

/// Stores entry `(r, c)` of the blocks `K_ij` of a column `j`.
#[inline(always)]
fn store_column<S: Simd>(
    column: &[Lanes<S>; 10],
    j: usize,
    r: usize,
    c: usize,
    out: &mut QuadraticPackMatrices,
    part: usize,
) {
    for i in 0..10 {
        if i < j {
            column[i].store(&mut out.off_diagonal[place(i, j)][3 * c + r], part);
        } else if i == j {
            column[i].store(&mut out.diagonal[i][TRIANGLE[r][c]], part);
        } else if r != c {
            column[i].store(&mut out.off_diagonal[place(j, i)][3 * r + c], part);
        }
    }
}

/// Place of the block of nodes `i < j` off the diagonal.
#[inline(always)]
const fn place(i: usize, j: usize) -> usize {
    i * (19 - i) / 2 + j - i - 1
}
