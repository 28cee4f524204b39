//! The critical step of explicit integration, from the largest eigenvalue of `M⁻¹ K`.
//!
//! `λ_max` is found by Lanczos' method on `M^{-1/2} K M^{-1/2}` with full orthogonalisation: its Ritz value is a lower
//! bound. The upper bound is certified: by Sylvester's law of inertia `λ_max < σ` exactly where `σ M - K` has a Cholesky
//! factor, and the factorisation that serves everything else here answers that. The critical step is taken from the
//! upper bound, so a step below it is stable for tissue near the configuration that was examined.
//!
//! The rule of thumb `h = Le/c`, with the shortest altitude of an element and the speed of pressure waves, knows neither
//! the mesh around the element nor damping; for linear tetrahedra the truth lies on either side of it.

#![allow(non_snake_case)]

use std::sync::Arc;

use nalgebra::DMatrix;

use super::{dot, norm};
use crate::{
    assembly::{Coefficients, FemWorkspace, assemble_with},
    factor::{Factor, FactorStatus, SymbolicFactor},
    model::{FemModel, FemState},
};

/// Most Lanczos vectors: the largest eigenvalue of a mesh is found to 1e-3 within a few dozen.
const MOST_VECTORS: usize = 120;

/// Relative residual of the Ritz pair at which the iteration ends.
const CLOSE: f64 = 1e-3;

/// Margins above the Ritz value that are tried for a certificate.
const MARGINS: [f64; 6] = [1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0];

/// The largest frequency of a body and the step that explicit integration bears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalStep {
    /// Lower bound of the largest frequency (rad/s): the root of the Ritz value.
    pub lower: f64,
    /// Upper bound of the largest frequency (rad/s), certified by a factorisation; infinite where none succeeded.
    pub upper: f64,
    /// Critical step (s) from the upper bound, stiffness damping included.
    pub step: f64,
    /// Lanczos vectors used.
    pub vectors: usize,
}

impl CriticalStep {
    /// Substeps into which a step `dt` (s) must be cut to stay at the share `safety` of the critical step.
    pub fn substeps(&self, dt: f64, safety: f64) -> u32 {
        // `as` saturates, so a critical step of zero asks for as many as there can be.
        (dt / (safety * self.step) * (1.0 - 1e-12)).ceil().max(1.0) as u32
    }
}

/// Critical step (s) for the largest frequency `omega` (rad/s) and stiffness damping `beta` (s); 0 for an infinite
/// frequency, at which no step is stable.
pub fn critical_for(omega: f64, beta: f64) -> f64 {
    if omega == f64::INFINITY {
        return 0.0;
    }
    let damping = 0.5 * beta * omega;
    // 2/ω (√(1 + ξ²) - ξ), without the cancellation.
    2.0 / (omega * ((1.0 + damping * damping).sqrt() + damping))
}

/// Examines a body in the configuration of `state`. For set-up: allocates.
///
/// Every free node must have mass ([`super::explicit::check_mass`]); the answer is meaningless otherwise.
pub fn critical_step(model: &FemModel, state: &FemState, symbolic: &Arc<SymbolicFactor>) -> CriticalStep {
    let mut ws = FemWorkspace::new(model);
    ws.filter = false;
    // Viscous tissue is stiffest at once, before it relaxes.
    ws.dt = 0.0;
    assemble_with(model, state, Coefficients::STATIC, &[], &mut ws);
    let (ritz, vectors) = largest_eigenvalue(model, &ws);
    // Stretched and compressed tissue may have no positive eigenvalue at all: any step is stable in the linear sense.
    let ritz = ritz.max(f64::MIN_POSITIVE);
    let bound = certify(model, &mut ws, ritz, symbolic);
    let (lower, upper) = (ritz.sqrt(), bound.sqrt());
    CriticalStep { lower, upper, step: critical_for(upper, model.rayleigh_stiffness()), vectors }
}

/// The largest Ritz value of `M^{-1/2} K M^{-1/2}` and the number of vectors it took.
fn largest_eigenvalue(model: &FemModel, ws: &FemWorkspace) -> (f64, usize) {
    let root: Vec<f64> =
        model.node_of_free().iter().flat_map(|&i| [model.mass()[i as usize].sqrt().recip(); 3]).collect();
    let n = root.len();
    let mut basis = vec![start(n)];
    let (mut alpha, mut beta) = (Vec::new(), Vec::new());
    let mut scaled = vec![0.0; n];
    let mut next = vec![0.0; n];
    let mut ritz = 0.0;
    while let Some(last) = basis.last() {
        scaled.iter_mut().zip(last.iter().zip(&root)).for_each(|(s, (x, r))| *s = x * r);
        ws.system.multiply(&scaled, &mut next);
        next.iter_mut().zip(&root).for_each(|(y, r)| *y *= r);
        alpha.push(dot(&next, last));
        // Twice: once leaves a component of the order of the cancellation.
        for vector in basis.iter().chain(&basis) {
            let component = dot(&next, vector);
            next.iter_mut().zip(vector).for_each(|(y, x)| *y -= component * x);
        }
        let length = norm(&next);
        let (value, share) = ritz_pair(&alpha, &beta);
        ritz = value;
        let exhausted = basis.len() >= MOST_VECTORS.min(n) || length <= f64::EPSILON * value.abs();
        if exhausted || length * share <= CLOSE * value.abs() || !length.is_finite() {
            break;
        }
        beta.push(length);
        basis.push(next.iter().map(|y| y / length).collect());
    }
    (ritz, basis.len())
}

/// The largest eigenvalue of the tridiagonal matrix and the size of its eigenvector's last component.
fn ritz_pair(alpha: &[f64], beta: &[f64]) -> (f64, f64) {
    let k = alpha.len();
    let matrix = DMatrix::from_fn(k, k, |i, j| match i.abs_diff(j) {
        0 => alpha[i],
        1 => beta[i.min(j)],
        _ => 0.0,
    });
    let eigen = matrix.symmetric_eigen();
    let (index, value) = eigen.eigenvalues.argmax();
    (value, eigen.eigenvectors[(k - 1, index)].abs())
}

/// A start vector without symmetry, of length one, the same on every machine.
fn start(n: usize) -> Vec<f64> {
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut vector: Vec<f64> = (0..n)
        .map(|_| {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        })
        .collect();
    let length = norm(&vector);
    vector.iter_mut().for_each(|x| *x /= length);
    vector
}

/// The least of a few values above `ritz` that no eigenvalue reaches.
fn certify(model: &FemModel, ws: &mut FemWorkspace, ritz: f64, symbolic: &Arc<SymbolicFactor>) -> f64 {
    let mut factor = Factor::new(Arc::clone(symbolic));
    let mut shifted = ws.system.clone();
    for margin in MARGINS {
        let bound = (1.0 + margin) * ritz;
        shifted.blocks.iter_mut().zip(&ws.system.blocks).for_each(|(s, k)| *s = -k);
        for (k, &node) in model.node_of_free().iter().enumerate() {
            if let Some(block) = model.pattern().find(k as u32, k as u32).and_then(|p| shifted.blocks.get_mut(p)) {
                (0..3).for_each(|c| block[(c, c)] += bound * model.mass()[node as usize]);
            }
        }
        if factor.refactor(&shifted).status == FactorStatus::Ok {
            return bound;
        }
    }
    f64::INFINITY
}
