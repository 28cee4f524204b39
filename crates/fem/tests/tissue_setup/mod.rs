//! Bodies and solvers shared by the tissue tests.
#![allow(dead_code)]

use nalgebra::{DMatrix, DVector, Vector3};
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble_with},
    element::ElementKind,
    material::{Law, Material},
    mesh::TetMesh,
    model::{FemModel, FemState},
};

/// A box of `cells` hexahedra, each cut into six tetrahedra; `distort` moves inner nodes by this share of a cell.
pub(crate) fn block(cells: [usize; 3], size: [f64; 3], distort: f64) -> TetMesh {
    let [nx, ny, nz] = cells;
    let node = |i: usize, j: usize, k: usize| (i + (nx + 1) * (j + (ny + 1) * k)) as u32;
    let mut random = Random(7);
    let mut mesh = TetMesh::default();
    for k in 0..=nz {
        for j in 0..=ny {
            for i in 0..=nx {
                let inner = i % nx != 0 && j % ny != 0 && k % nz != 0;
                let mut place = |a: usize, n: usize, length: f64| {
                    let shift = if inner { distort * random.symmetric() } else { 0.0 };
                    length * (a as f64 + shift) / n as f64
                };
                mesh.nodes.push(Vector3::new(place(i, nx, size[0]), place(j, ny, size[1]), place(k, nz, size[2])));
            }
        }
    }
    // Kuhn's six tetrahedra around the diagonal of a cell: one for each order of the axes.
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
                    let mut at = [i, j, k];
                    let mut tetrahedron = [node(i, j, k); 4];
                    for (step, axis) in order.into_iter().enumerate() {
                        at[axis] += 1;
                        tetrahedron[step + 1] = node(at[0], at[1], at[2]);
                    }
                    if [[0, 2, 1], [2, 1, 0], [1, 0, 2]].contains(&order) {
                        tetrahedron.swap(1, 2);
                    }
                    mesh.tetrahedra.push(tetrahedron);
                }
            }
        }
    }
    mesh
}

/// Every registered law with the same small-strain parameters.
pub(crate) fn all_materials(young: f64, poisson: f64) -> Vec<Material> {
    Material::NAMES.iter().map(|name| Material::from_young_poisson(name, young, poisson).unwrap()).collect()
}

/// Nodes of a mesh for which `condition` holds.
pub(crate) fn nodes_where(mesh: &TetMesh, condition: impl Fn(&Vector3<f64>) -> bool) -> Vec<u32> {
    (0..mesh.nodes.len() as u32).filter(|&i| condition(&mesh.nodes[i as usize])).collect()
}

/// A small reproducible random sequence (xorshift).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in `[-1, 1)`.
    pub(crate) fn symmetric(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A vector in the cube `[-1, 1)³`.
    pub(crate) fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.symmetric(), self.symmetric(), self.symmetric())
    }
}

/// The matrix of the workspace as a dense one.
pub(crate) fn dense(ws: &FemWorkspace) -> DMatrix<f64> {
    let pattern = &ws.system.pattern;
    let n = 3 * pattern.rows();
    let mut matrix = DMatrix::zeros(n, n);
    for i in 0..pattern.rows() {
        for p in pattern.row(i) {
            let j = pattern.columns()[p] as usize;
            matrix.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&ws.system.blocks[p]);
        }
    }
    matrix
}

/// Static equilibrium by Newton's method with a dense factor; halves a step that does not lower the residual.
/// Returns the norm of the last residual (N).
pub(crate) fn equilibrium_dense(model: &FemModel, state: &mut FemState, ws: &mut FemWorkspace, tolerance: f64) -> f64 {
    let norm = |ws: &FemWorkspace| ws.rhs.iter().map(|x| x * x).sum::<f64>().sqrt();
    assemble_with(model, state, Coefficients::STATIC, &[], ws);
    let mut residual = norm(ws);
    for _ in 0..60 {
        if residual <= tolerance {
            break;
        }
        let step = dense(ws).lu().solve(&DVector::from_column_slice(&ws.rhs)).expect("regular tangent");
        let before = state.q.clone();
        let mut length = 1.0;
        for _ in 0..30 {
            move_free(model, &before, step.as_slice(), length, state);
            assemble_with(model, state, Coefficients::STATIC, &[], ws);
            if norm(ws) < residual {
                break;
            }
            length *= 0.5;
        }
        let reached = norm(ws);
        if reached >= residual {
            break;
        }
        residual = reached;
    }
    residual
}

/// `q = before + length step` at the free nodes.
pub(crate) fn move_free(model: &FemModel, before: &[Vector3<f64>], step: &[f64], length: f64, state: &mut FemState) {
    for (k, &i) in model.node_of_free().iter().enumerate() {
        let d = Vector3::new(step[3 * k], step[3 * k + 1], step[3 * k + 2]);
        state.q[i as usize] = before[i as usize] + d * length;
    }
}

/// Solves `A x = b` by conjugate gradients with the diagonal as preconditioner, to a relative residual.
pub(crate) fn conjugate_gradients(ws: &FemWorkspace, b: &[f64], relative: f64) -> Vec<f64> {
    let n = b.len();
    let mut inverse = vec![0.0; n];
    let pattern = &ws.system.pattern;
    for i in 0..pattern.rows() {
        let p = pattern.find(i as u32, i as u32).expect("diagonal");
        for c in 0..3 {
            inverse[3 * i + c] = 1.0 / ws.system.blocks[p][(c, c)];
        }
    }
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let (mut x, mut r) = (vec![0.0; n], b.to_vec());
    let mut z: Vec<f64> = r.iter().zip(&inverse).map(|(r, d)| r * d).collect();
    let (mut p, mut q) = (z.clone(), vec![0.0; n]);
    let mut rho = dot(&r, &z);
    let stop = relative * dot(b, b).sqrt();
    for _ in 0..20 * n {
        if dot(&r, &r).sqrt() <= stop {
            break;
        }
        ws.system.multiply(&p, &mut q);
        let alpha = rho / dot(&p, &q);
        for i in 0..n {
            x[i] += alpha * p[i];
            r[i] -= alpha * q[i];
            z[i] = r[i] * inverse[i];
        }
        let next = dot(&r, &z);
        for i in 0..n {
            p[i] = z[i] + next / rho * p[i];
        }
        rho = next;
    }
    x
}

/// The mesh as elements of this kind need it.
pub(crate) fn mesh_for(mesh: &TetMesh, kind: ElementKind) -> TetMesh {
    if kind == ElementKind::Quadratic { mesh.promoted() } else { mesh.clone() }
}

/// Every registered law that elements of this kind can be made of, with the same small-strain parameters.
pub(crate) fn laws_for(kind: ElementKind, young: f64, poisson: f64) -> Vec<Material> {
    let mut laws = all_materials(young, poisson);
    laws.retain(|law| kind != ElementKind::Averaged || law.without_bulk().is_some());
    laws
}
