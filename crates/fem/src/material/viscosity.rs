//! Prony viscosity on a hyperelastic law: generalised Maxwell branches on the shear part of its stress.
//!
//! Every law is `Ψ = Ψ_b + Ψ_s`, linear in its bulk modulus (`Ψ_b`) and in its shear modulus (`Ψ_s`), which is the
//! instantaneous one. With `S_s = 2 ∂Ψ_s/∂C` and one stress `γ_m` (second Piola, so objective) per term `(α_m, τ_m)`
//! ```text
//! S = S_b + S_s - Σ γ_m,     τ_m γ̇_m = α_m S_s - γ_m,     G(t) = G0 (1 - Σ α_m (1 - e^(-t/τ_m)))      Pa
//! ```
//! [Simo 1987; Marchesseau 2010]. The bulk response stays elastic: exactly for the isochoric laws, where `Ψ_b = k/2 ln²J`;
//! for the others it is what the bulk modulus multiplies, `Ψ` at zero shear modulus. Backward Euler over a step `h` gives
//! ```text
//! γ_m⁺ = a_m S_s + b_m γ_m,    a_m = α_m h/(h+τ_m),   b_m = τ_m/(h+τ_m)
//! P = P_b + (1 - Σ a_m) P_s - F Γ,    Γ = Σ b_m γ_m    (γ_m of the begin of the step)
//! ```
//! the derivative of `Ψ_b + (1 - Σ a_m) Ψ_s - Γ : (C - I)/2`: within a step viscous tissue is the same law with a lower
//! shear modulus and a constant stress `-Γ` in the rest frame, which adds `-V0 (D_i·Γ D_j) I` to the tangent. A step without
//! end (`h = ∞`) is the relaxed equilibrium.
//!
//! `S_s = F⁻¹ P_s` grows without bound in a flat element. Below `|J| =` [`EXTENSION_BELOW`] its division by `J` is replaced by
//! one by the bound, with the sign of `J`: the memory of such an element is too small, finite, and exact again when `J` is.

#![allow(non_snake_case)]

use nalgebra::{Cholesky, Matrix3, SMatrix, Vector6};
use serde::{Deserialize, Serialize};

use super::{Law, Material, MaterialError, volume::EXTENSION_BELOW};
use crate::{
    element::{ElementMatrices, Tetrahedron},
    rotation::{cofactor, signed_svd},
};

/// One Maxwell branch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PronyTerm {
    /// Share `α` of the instantaneous shear modulus that relaxes, in `(0, 1)`; the shares of a series add up to below 1.
    pub modulus: f64,
    /// Relaxation time `τ` (s), positive.
    pub time: f64,
}

/// Checks a Prony series; no terms is no viscosity.
///
/// # Errors
/// A share or time that is not positive and finite, shares that leave no stiffness at rest.
pub fn validate_prony(terms: &[PronyTerm]) -> Result<(), MaterialError> {
    for (term, &PronyTerm { modulus, time }) in terms.iter().enumerate() {
        if !(modulus > 0.0 && modulus < 1.0) {
            return Err(MaterialError::PronyModulus { term, modulus });
        }
        if !(time > 0.0 && time.is_finite()) {
            return Err(MaterialError::PronyTime { term, time });
        }
    }
    let sum = terms.iter().map(|t| t.modulus).sum::<f64>();
    if sum < 1.0 { Ok(()) } else { Err(MaterialError::PronySum(sum)) }
}

/// Tolerance of the test for a definite tangent, relative to its largest diagonal entry: rotations of an
/// element free of stress have eigenvalue zero.
const ROUNDING: f64 = 1e-10;

/// A validated Prony series over one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relaxation<'a> {
    pub(crate) terms: &'a [PronyTerm],
    /// The step `h` (s); infinity for the relaxed equilibrium.
    pub(crate) dt: f64,
}

impl Relaxation<'_> {
    /// `h / (h + τ)`.
    fn done(&self, term: &PronyTerm) -> f64 {
        (1.0 + term.time / self.dt).recip()
    }

    /// `Σ a_m`: the share of the shear modulus that is gone at the end of the step.
    pub(crate) fn share(&self) -> f64 {
        self.terms.iter().map(|t| t.modulus * self.done(t)).sum()
    }

    /// `Γ` (Pa) from the stresses of one element at the begin of the step.
    pub(crate) fn memory(&self, history: &[Vector6<f64>]) -> Matrix3<f64> {
        let terms = self.terms.iter().zip(history);
        symmetric(&terms.map(|(t, stress)| stress * (1.0 - self.done(t))).sum())
    }

    /// Moves the stresses of one element to the end of the step, where its deformation gradient is `F`.
    pub(crate) fn advance(&self, law: &Material, F: &Matrix3<f64>, history: &mut [Vector6<f64>]) {
        let S = shear_stress(law, F);
        for (term, stress) in self.terms.iter().zip(history) {
            let done = self.done(term);
            *stress = S * (term.modulus * done) + *stress * (1.0 - done);
        }
    }
}

/// Adds the stress `-Γ` to one element whose law is already in `out`. Returns whether the filter changed the tangent.
///
/// With `filter` the law's tangent is semidefinite by itself. Where it is not so any more with the memory, the memory's share
/// of the tangent is replaced by its semidefinite part.
pub(crate) fn add_memory(
    element: &Tetrahedron,
    F: &Matrix3<f64>,
    memory: &Matrix3<f64>,
    filter: bool,
    out: &mut ElementMatrices,
) -> bool {
    out.forces += element.forces(&(F * -memory));
    subtract_memory(element, memory, &mut out.blocks);
    if !filter || is_semidefinite(&out.blocks) {
        return false;
    }
    // What is left of -Γ is its semidefinite part [Higham 1988]: (|Γ| + Γ) / 2 is given back.
    let svd = signed_svd(memory);
    let absolute = svd.V * Matrix3::from_diagonal(&svd.sigma.abs()) * svd.V.transpose();
    subtract_memory(element, &((memory + absolute) * -0.5), &mut out.blocks);
    true
}

/// `S_s` of an element (Pa), bounded where it is flat.
fn shear_stress(law: &Material, F: &Matrix3<f64>) -> Vector6<f64> {
    // Linear in the shear modulus: the difference to half of it is half of its part.
    let P = (law.first_piola(F) - law.relaxed(0.5).first_piola(F)) * 2.0;
    let J = F.determinant();
    let bounded = if J.abs() > EXTENSION_BELOW { J } else { EXTENSION_BELOW.copysign(J) };
    let S = cofactor(F).transpose() * P / bounded;
    let off = |a, b| 0.5 * (S[(a, b)] + S[(b, a)]);
    Vector6::new(S[(0, 0)], S[(1, 1)], S[(2, 2)], off(1, 2), off(0, 2), off(0, 1))
}

/// The symmetric matrix of `xx, yy, zz, yz, xz, xy`.
fn symmetric(s: &Vector6<f64>) -> Matrix3<f64> {
    Matrix3::new(s[0], s[5], s[4], s[5], s[1], s[3], s[4], s[3], s[2])
}

/// `K_ij -= V0 (D_i·Γ D_j) I`.
fn subtract_memory(element: &Tetrahedron, memory: &Matrix3<f64>, blocks: &mut [Matrix3<f64>; 6]) {
    let D = element.inverse_rest_edges;
    let product = D * memory * D.transpose() * element.volume;
    let mut k = 0;
    for i in 0..3 {
        for j in i..3 {
            for c in 0..3 {
                blocks[k][(c, c)] -= product[(i, j)];
            }
            k += 1;
        }
    }
}

/// Whether the stiffness of nodes 1, 2, 3 is positive semidefinite to rounding, and with it that of the element.
fn is_semidefinite(blocks: &[Matrix3<f64>; 6]) -> bool {
    let mut K = SMatrix::<f64, 9, 9>::zeros();
    let mut k = 0;
    for i in 0..3 {
        for j in i..3 {
            // Cholesky's method reads the lower half.
            K.fixed_view_mut::<3, 3>(3 * j, 3 * i).copy_from(&blocks[k].transpose());
            k += 1;
        }
    }
    let shift = ROUNDING * K.diagonal().amax();
    for c in 0..9 {
        K[(c, c)] += shift;
    }
    Cholesky::new(K).is_some()
}
