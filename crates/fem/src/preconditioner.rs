//! Preconditioners of the conjugate gradients.

use nalgebra::{Matrix3, Vector3};

use crate::factor::{Factor, SolveStatus, SolveWorkspace};
use crate::sparse::SystemMatrix;

/// A symmetric positive definite approximation `P` of the system matrix that is cheap to solve with.
pub trait Preconditioner {
    /// `z = P⁻¹ r`. On anything but [`SolveStatus::Ok`] the content of `z` is unspecified.
    fn apply(&mut self, r: &[f64], z: &mut [f64]) -> SolveStatus;
}

/// `P` = the matrix that was factored.
pub struct FactorPreconditioner<'a> {
    /// The latest good factor.
    pub factor: &'a Factor,
    /// Scratch of its solves.
    pub workspace: &'a mut SolveWorkspace,
}

impl Preconditioner for FactorPreconditioner<'_> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) -> SolveStatus {
        if r.len() != z.len() {
            return SolveStatus::WrongSize;
        }
        z.copy_from_slice(r);
        self.factor.solve(z, self.workspace)
    }
}

/// `P⁻¹ = R A₀⁻¹ Rᵀ`: an older factor, carried along by the nodal rotations `R` since it was taken
/// (Courtecuisse et al. 2010). By the factor's copy in 16 bits where it keeps one: an old factor is wrong by far more than
/// rounding.
pub struct WarpedPreconditioner<'a> {
    /// The latest good factor, of `A₀`.
    pub factor: &'a Factor,
    /// Rotation of each free node from the shape that was factored to the present one.
    pub rotations: &'a [Matrix3<f64>],
    /// Scratch of the factor's solves.
    pub workspace: &'a mut SolveWorkspace,
}

impl Preconditioner for WarpedPreconditioner<'_> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) -> SolveStatus {
        if r.len() != z.len() || 3 * self.rotations.len() != z.len() {
            return SolveStatus::WrongSize;
        }
        z.copy_from_slice(r);
        rotate_back(self.rotations, z);
        let status = self.factor.precondition(z, self.workspace);
        rotate(self.rotations, z);
        status
    }
}

/// `P` = the diagonal 3 x 3 blocks of `A`: needs no factor; used until there is one, and as a baseline.
#[derive(Clone, Debug)]
pub struct BlockJacobi {
    inverse: Vec<Matrix3<f64>>,
}

impl BlockJacobi {
    /// Memory for `nodes` free nodes; the identity until [`Self::update`].
    pub fn new(nodes: usize) -> Self {
        Self { inverse: vec![Matrix3::identity(); nodes] }
    }

    /// Takes the blocks of `a`. A block that is not positive definite or not finite counts as the identity, so that
    /// `P` stays positive definite; returns the number of such blocks. Allocates nothing.
    pub fn update(&mut self, a: &SystemMatrix) -> usize {
        let mut replaced = 0;
        for (i, inverse) in self.inverse.iter_mut().enumerate().take(a.pattern.rows()) {
            let block = a.pattern.find(i as u32, i as u32).and_then(|p| a.blocks.get(p));
            *inverse = block.and_then(inverse_of_positive).unwrap_or_else(|| {
                replaced += 1;
                Matrix3::identity()
            });
        }
        replaced
    }
}

impl Preconditioner for BlockJacobi {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) -> SolveStatus {
        if r.len() != 3 * self.inverse.len() || z.len() != r.len() {
            return SolveStatus::WrongSize;
        }
        for ((inverse, r), z) in self.inverse.iter().zip(r.chunks_exact(3)).zip(z.chunks_exact_mut(3)) {
            z.copy_from_slice((inverse * Vector3::new(r[0], r[1], r[2])).as_slice());
        }
        SolveStatus::Ok
    }
}

/// Inverse of a symmetric block by its Cholesky factor, if it is positive definite.
fn inverse_of_positive(block: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let inverse = block.cholesky()?.inverse();
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// `x ← R x`, node by node: a correction from the frame of an older factor into the present one.
pub fn rotate(rotations: &[Matrix3<f64>], x: &mut [f64]) {
    for (rotation, x) in rotations.iter().zip(x.chunks_exact_mut(3)) {
        x.copy_from_slice((rotation * Vector3::new(x[0], x[1], x[2])).as_slice());
    }
}

/// `x ← Rᵀ x`, node by node.
pub fn rotate_back(rotations: &[Matrix3<f64>], x: &mut [f64]) {
    for (rotation, x) in rotations.iter().zip(x.chunks_exact_mut(3)) {
        x.copy_from_slice(rotation.tr_mul(&Vector3::new(x[0], x[1], x[2])).as_slice());
    }
}
