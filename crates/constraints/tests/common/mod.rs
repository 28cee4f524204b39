//! What the tests share: a block with a flat top, and a dense inverse.
#![allow(dead_code, unreachable_pub)] // each test binary uses a part

use nalgebra::{DMatrix, DMatrixViewMut, Isometry3, Translation3, UnitQuaternion, Vector3};
use palpate_collision::{
    ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, SurfaceGeometry, ToolShape, detect,
};
use palpate_constraints::compliance::InverseRows;
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::sparse::FIXED;

/// A bumpy open patch of `n x n` squares of `cell` m about the origin, facing up.
pub fn patch(n: usize, cell: f64) -> (SurfaceGeometry, Vec<Vector3<f64>>) {
    let at = |i: usize, j: usize| {
        let (x, y) = ((i as f64 - n as f64 / 2.0) * cell, (j as f64 - n as f64 / 2.0) * cell);
        Vector3::new(x, y, 0.0006 * ((x * 310.0).sin() + (y * 270.0).cos()))
    };
    let positions: Vec<_> = (0..=n).flat_map(|i| (0..=n).map(move |j| at(i, j))).collect();
    let id = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    let triangles = (0..n)
        .flat_map(|i| (0..n).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    (SurfaceGeometry::new(triangles, &positions).unwrap(), positions)
}

/// Every node free but the multiples of `every` (0: none fixed).
pub fn free_nodes(nodes: usize, every: usize) -> (Vec<u32>, usize) {
    let mut next = 0;
    let map = (0..nodes)
        .map(|k| {
            if every > 0 && k.is_multiple_of(every) {
                return FIXED;
            }
            next += 1;
            next - 1
        })
        .collect();
    (map, next as usize)
}

pub fn pose(p: Vector3<f64>, rotation: Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(p), UnitQuaternion::from_scaled_axis(rotation))
}

pub fn box_hull(half: [f64; 3]) -> ToolShape {
    let vertices: Vec<_> =
        (0..8).map(|k| Vector3::from_fn(|i, _| if k >> i & 1 == 1 { half[i] } else { -half[i] })).collect();
    ToolShape::convex(&vertices).unwrap()
}

pub fn find(
    surface: &SurfaceGeometry,
    positions: &[Vector3<f64>],
    tool: &ToolShape,
    pose: &Isometry3<f64>,
    kind: ContactKind,
) -> ContactSet {
    let config = DetectionConfig { kind, max_contacts: 1000, ..DetectionConfig::default() };
    let mut set = ContactSet::default();
    detect(surface, positions, tool, pose, &config, &mut DetectionWorkspace::new(surface), &mut set);
    set
}

/// `A⁻¹` as a dense matrix; its workspace keeps `Hᵀ` and the product.
pub struct DenseInverse(pub DMatrix<f64>);

#[derive(Default)]
pub struct DenseWorkspace {
    rows: Vec<Vec<(u32, Vector3<f64>)>>,
}

impl DenseWorkspace {
    pub fn with_capacity(rows: usize) -> Self {
        Self { rows: (0..rows).map(|_| Vec::with_capacity(3)).collect() }
    }
}

impl InverseRows for DenseInverse {
    type Workspace = DenseWorkspace;

    fn compliance_into(
        &self,
        rows: &NodalRows,
        scale: f64,
        mut w: DMatrixViewMut<'_, f64>,
        ws: &mut DenseWorkspace,
    ) -> bool {
        ws.rows.iter_mut().for_each(Vec::clear);
        for r in 0..rows.len() {
            if ws.rows.len() == r {
                ws.rows.push(Vec::new());
            }
            ws.rows[r].extend(rows.row(r));
        }
        for i in 0..rows.len() {
            for j in 0..rows.len() {
                let mut sum = 0.0;
                for (a, u) in &ws.rows[i] {
                    for (b, v) in &ws.rows[j] {
                        let block = self.0.fixed_view::<3, 3>(3 * *a as usize, 3 * *b as usize);
                        sum += u.dot(&(block * v));
                    }
                }
                w[(i, j)] = scale * sum;
            }
        }
        true
    }

    fn correct(&self, lambda: &[f64], x: &mut [f64], ws: &mut DenseWorkspace) -> bool {
        x.fill(0.0);
        for (row, l) in ws.rows.iter().zip(lambda) {
            for (k, v) in row {
                for c in 0..3 {
                    let column = self.0.column(3 * *k as usize + c);
                    x.iter_mut().zip(column.iter()).for_each(|(x, a)| *x += a * v[c] * l);
                }
            }
        }
        lambda.len() == ws.rows.iter().filter(|r| !r.is_empty()).count()
    }
}

/// A symmetric positive definite matrix of size `n` [kg], always the same.
pub fn spd(n: usize) -> DMatrix<f64> {
    let b = DMatrix::from_fn(n, n, |i, j| ((i * 7 + j * 13) % 11) as f64 / 11.0 - 0.4);
    &b * b.transpose() * 0.01 + DMatrix::identity(n, n) * 0.05
}
