//! What the tests of the integrators share: bodies, modes and energies.
#![allow(dead_code)]

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Vector3};
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble_with, elastic_energy},
    block::{block, evenly},
    factor::SymbolicFactor,
    integrator::newton::ImplicitWorkspace,
    material::Material,
    mesh::TetMesh,
    model::{FemConfig, FemModel, FemState},
};

/// A bar along x of 4 x 1 x 1 cells, 8 x 2 x 2 cm.
pub(crate) fn bar() -> TetMesh {
    bar_of([4, 1, 1])
}

/// The same bar of other cells.
pub(crate) fn bar_of(cells: [usize; 3]) -> TetMesh {
    block(&evenly(0.0, 0.08, cells[0]), &evenly(0.0, 0.02, cells[1]), &evenly(0.0, 0.02, cells[2]))
}

/// Soft tissue of 5 kPa without gravity and damping, clamped at `x = 0`.
pub(crate) fn clamped(mesh: &TetMesh, law: &str) -> FemConfig {
    FemConfig {
        material: Material::from_young_poisson(law, 5e3, 0.4).unwrap(),
        density: 1000.0,
        gravity: Vector3::zeros(),
        fixed: mesh.node_sets["x_min"].clone(),
        ..FemConfig::default()
    }
}

/// Model, symbolic factor and implicit workspace.
pub(crate) fn body(mesh: &TetMesh, config: &FemConfig) -> (FemModel, Arc<SymbolicFactor>, ImplicitWorkspace) {
    let model = FemModel::new(mesh, config).unwrap();
    let positions: Vec<_> = model.node_of_free().iter().map(|&n| mesh.nodes[n as usize]).collect();
    let symbolic = Arc::new(SymbolicFactor::new(model.pattern(), &positions).unwrap());
    let ws = ImplicitWorkspace::new(&model, &symbolic);
    (model, symbolic, ws)
}

/// Modes of a body at rest: frequencies (rad/s) ascending, and vectors `φ` with `φᵀ M φ = 1` as columns.
pub(crate) struct Modes {
    pub(crate) omega: Vec<f64>,
    pub(crate) shape: DMatrix<f64>,
    mass: Vec<f64>,
}

impl Modes {
    pub(crate) fn new(model: &FemModel) -> Self {
        let mut ws = FemWorkspace::new(model);
        assemble_with(model, &model.rest_state(), Coefficients::STATIC, &[], &mut ws);
        let mass: Vec<f64> = model.node_of_free().iter().flat_map(|&i| [model.mass()[i as usize]; 3]).collect();
        let n = mass.len();
        let mut matrix = DMatrix::zeros(n, n);
        let pattern = &ws.system.pattern;
        for i in 0..pattern.rows() {
            for p in pattern.row(i) {
                let j = pattern.columns()[p] as usize;
                for (r, c) in (0..9).map(|k| (k % 3, k / 3)) {
                    let scale = (mass[3 * i] * mass[3 * j]).sqrt();
                    matrix[(3 * i + r, 3 * j + c)] = ws.system.blocks[p][(r, c)] / scale;
                }
            }
        }
        let eigen = matrix.symmetric_eigen();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let omega = order.iter().map(|&k| eigen.eigenvalues[k].max(0.0).sqrt()).collect();
        let shape = DMatrix::from_fn(n, n, |i, k| eigen.eigenvectors[(i, order[k])] / mass[i].sqrt());
        Self { omega, shape, mass }
    }

    /// The body at rest but for mode `k`, deflected so far that its farthest node moves by `size` (m).
    pub(crate) fn deflected(&self, model: &FemModel, k: usize, size: f64) -> (FemState, f64) {
        let amplitude = size / self.shape.column(k).amax();
        let mut state = model.rest_state();
        for (a, &node) in model.node_of_free().iter().enumerate() {
            let phi = Vector3::from_fn(|c, _| self.shape[(3 * a + c, k)]);
            state.q[node as usize] += phi * amplitude;
        }
        (state, amplitude)
    }

    /// Amplitudes of mode `k` in the displacement and in the velocity.
    pub(crate) fn of(&self, model: &FemModel, state: &FemState, k: usize) -> [f64; 2] {
        let project = |value: &dyn Fn(usize) -> Vector3<f64>| -> f64 {
            let u = DVector::from_iterator(
                self.mass.len(),
                model.node_of_free().iter().flat_map(|&i| value(i as usize).data.0[0]),
            );
            (0..u.len()).map(|i| self.shape[(i, k)] * self.mass[i] * u[i]).sum()
        };
        [project(&|i| state.q[i] - model.q_rest()[i]), project(&|i| state.v[i])]
    }
}

/// Kinetic, elastic and gravitational energy (J).
pub(crate) fn energy(model: &FemModel, state: &FemState) -> f64 {
    let mut sum = elastic_energy(model, state);
    for &node in model.node_of_free() {
        let i = node as usize;
        sum += model.mass()[i] * (0.5 * state.v[i].norm_squared() - model.gravity().dot(&state.q[i]));
    }
    sum
}

/// Largest distance of two configurations (m).
pub(crate) fn distance(a: &FemState, b: &FemState) -> f64 {
    a.q.iter().zip(&b.q).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}
