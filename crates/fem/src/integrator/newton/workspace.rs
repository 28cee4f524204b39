//! Memory of implicit steps and of equilibria.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use crate::{
    assembly::FemWorkspace,
    factor::{Factor, SolveWorkspace, SymbolicFactor},
    model::{FemModel, FemState},
    sparse::SystemMatrix,
};

/// Scratch of implicit steps and of equilibria.
pub struct ImplicitWorkspace {
    /// Forces and matrix of the last assembly.
    pub fem: FemWorkspace,
    /// The factor of the last linear solve.
    pub factor: Factor,
    pub(in crate::integrator) solve: SolveWorkspace,
    /// `K0`, where there is stiffness damping.
    pub(in crate::integrator) damping: Option<SystemMatrix>,
    /// Configuration `q0` at the begin of the step, or of the path of loads (m).
    pub(in crate::integrator) start: Vec<Vector3<f64>>,
    /// `q̃` of a step (m); the last equilibrium of a path.
    pub(in crate::integrator) predicted: Vec<Vector3<f64>>,
    /// Configuration from which a line is searched (m).
    pub(in crate::integrator) base: Vec<Vector3<f64>>,
    pub(in crate::integrator) residual: Vec<f64>,
    pub(in crate::integrator) direction: Vec<f64>,
    pub(in crate::integrator) moved: Vec<f64>,
    pub(in crate::integrator) product: Vec<f64>,
    /// Farthest that an iteration may move a node (m).
    pub(super) reach: f64,
    /// Whether every iteration takes the filtered tangent.
    pub(super) filtered: bool,
    /// Places of the diagonal blocks.
    pub(super) diagonal: Vec<u32>,
}

impl ImplicitWorkspace {
    /// Memory for a body whose pattern has been analysed.
    pub fn new(model: &FemModel, symbolic: &Arc<SymbolicFactor>) -> Self {
        let zeros = vec![0.0; 3 * model.free_nodes()];
        let damped = model.rayleigh_stiffness() > 0.0;
        let place = |i: u32| model.pattern().find(i, i).map_or(u32::MAX, |p| p as u32);
        Self {
            fem: FemWorkspace::new(model),
            factor: Factor::new(Arc::clone(symbolic)),
            solve: SolveWorkspace::new(symbolic),
            damping: damped.then(|| SystemMatrix::zeros(model.pattern().clone())),
            start: model.q_rest().to_vec(),
            predicted: model.q_rest().to_vec(),
            base: model.q_rest().to_vec(),
            residual: zeros.clone(),
            direction: zeros.clone(),
            moved: zeros.clone(),
            product: zeros,
            reach: f64::INFINITY,
            filtered: false,
            diagonal: (0..model.free_nodes() as u32).map(place).collect(),
        }
    }

    /// Memory for steps of tissue in trouble, begun crushed or inside out: filtered tangents throughout, no iteration moves
    /// a node by more than `reach` (m), and stiffness damping is left out. That of crushed tissue is as large as its
    /// tangent, and since fixed nodes count as resting it would hold tissue shut between an end that moves and the rest.
    pub fn careful(model: &FemModel, symbolic: &Arc<SymbolicFactor>, reach: f64) -> Self {
        Self { damping: None, reach, filtered: true, ..Self::new(model, symbolic) }
    }

    /// The diagonal blocks of the last matrix.
    pub(super) fn diagonal_blocks(&self) -> impl Iterator<Item = &Matrix3<f64>> {
        self.diagonal.iter().filter_map(|&p| self.fem.system.blocks.get(p as usize))
    }

    /// Rounding of the forces (N): positions of size `|q|` times the stiffness, in the last binary digits.
    pub(super) fn rounding(&self, state: &FemState, scale: f64) -> f64 {
        let size = state.q.iter().map(Vector3::amax).fold(0.0, f64::max);
        let stiffness: f64 = self.diagonal_blocks().map(|b| b.diagonal().norm_squared()).sum();
        4.0 * f64::EPSILON * size * stiffness.sqrt() / (scale * scale)
    }

    /// Rounding of the energy (J). Energies of elements are sums of terms that cancel at small strain: each is known to
    /// the last digits of its stiffness times the square of its length, here the size of the body over `∛n`.
    pub(super) fn energy_rounding(&self, state: &FemState, scale: f64) -> f64 {
        let size = state.q.iter().map(Vector3::amax).fold(0.0, f64::max);
        let stiffness: f64 = self.diagonal_blocks().map(|b| b.trace().abs()).sum();
        let length = size / (self.diagonal.len().max(1) as f64).cbrt();
        8.0 * f64::EPSILON * stiffness * (length / scale).powi(2)
    }
}
