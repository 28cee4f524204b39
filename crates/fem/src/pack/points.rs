//! Packs of quadratic elements to linear ones at their points of quadrature, and back.

use pulp::{Simd, WithSimd};

use super::{
    Edges, PACK, PackMatrices, QuadraticPackMatrices, Row, curved,
    quadratic::{PointMatrices, QuadraticPack, Shape},
    straight,
};
use crate::{
    element::quadratic::POINTS,
    lanes::{Lanes, Real},
    material::kernel::TRIANGLE,
};

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

/// Edges of the linear elements that stand for the points.
pub(super) struct EdgesAtPoints<'a> {
    pub(super) pack: &'a QuadraticPack,
    /// Nodes from node 0 on (m).
    pub(super) x: &'a [[Row; 3]; 10],
    pub(super) edges: &'a mut [Edges; POINTS],
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

/// Forces of the nodes from those at the points.
pub(super) struct Forces<'a> {
    pub(super) pack: &'a QuadraticPack,
    pub(super) points: &'a PointMatrices,
    pub(super) out: &'a mut QuadraticPackMatrices,
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

/// Entries `(r, c)` and `(c, r)` of all blocks from those at the points.
pub(super) struct Blocks<'a> {
    pub(super) pack: &'a QuadraticPack,
    pub(super) points: &'a PointMatrices,
    pub(super) r: usize,
    pub(super) c: usize,
    pub(super) out: &'a mut QuadraticPackMatrices,
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

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};
    use pulp::{Arch, Scalar, Scalar128b, Scalar256b, Scalar512b};

    use super::*;
    use crate::{
        element::{QuadraticTetrahedron, Tetrahedron, quadratic::EDGES},
        material::{Law, NeoHookean, kernel::Dispatch},
    };

    /// Seven elements, stretched to inverted, with mid-nodes moved by `curvature` (m).
    fn body(curvature: f64) -> (QuadraticPack, Vec<Vector3<f64>>) {
        let corners = [[0.0; 3], [0.02, 0.001, 0.0], [0.003, 0.02, 0.0], [-0.002, 0.004, 0.02]].map(Vector3::from);
        let (mut rest, mut q) = (Vec::new(), Vec::new());
        let (mut elements, mut linear) = (Vec::new(), Vec::new());
        for e in 0..7 {
            let first = 10 * e as u32;
            rest.extend(corners);
            rest.extend(EDGES.map(|(a, b)| (corners[a] + corners[b]) * 0.5 + Vector3::new(0.0, curvature, curvature)));
            elements.extend(QuadraticTetrahedron::new(std::array::from_fn(|i| first + i as u32), &rest));
            linear.extend(Tetrahedron::new([first, first + 1, first + 2, first + 3], &rest));
            let F = Matrix3::new(1.3, 0.2, -0.1 * e as f64, 0.0, 0.8, 0.3, 0.1, 0.0, 1.0 - 0.25 * e as f64);
            q.extend(rest[10 * e..].iter().map(|x| F * x + Vector3::new(x.y * x.z, 0.0, x.x * x.x) * 20.0));
        }
        (QuadraticPack::new(&elements, &linear).expect("seven elements"), q)
    }

    fn answer(dispatch: impl Dispatch, curvature: f64) -> Vec<f64> {
        let (pack, q) = body(curvature);
        let mut points = [PackMatrices::ZERO; POINTS];
        for (at, point) in pack.at_points_on(dispatch, &q).iter().zip(&mut points) {
            NeoHookean::from_young_poisson(5e3, 0.45).pack(at, true, point);
        }
        let mut out = QuadraticPackMatrices::ZERO;
        pack.sum_points_on(dispatch, &points, &mut out);
        let rows = out.forces.as_flattened().iter().chain(out.diagonal.as_flattened());
        rows.chain(out.off_diagonal.as_flattened()).flat_map(|row| &row[..pack.len]).copied().collect()
    }

    #[test]
    fn vectors_of_every_width_give_the_same_bits() {
        for curvature in [0.0, 0.0005] {
            let widest = answer(Arch::new(), curvature);
            assert!(widest.iter().all(|x| x.is_finite()) && widest.iter().any(|x| x.abs() > 1.0));
            assert_eq!(answer(Scalar, curvature), widest, "one element at a time");
            assert_eq!(answer(Scalar128b, curvature), widest, "two");
            assert_eq!(answer(Scalar256b, curvature), widest, "four");
            assert_eq!(answer(Scalar512b, curvature), widest, "eight");
        }
    }
}
