//! Laws in the multiplicative-Jacobian form `Ψ = Σ_k f^k(J) g^k(C)` and their element kernel
//! [Marchesseau, Heimann, Chatelin, Willinger, Delingette 2010].
//!
//! With `S^k = 2 ∂g^k/∂C`, `C = FᵀF`, `J = det F` and the sums
//! ```text
//! S  = Σ f S^k     s1 = Σ f' g     s2 = Σ f'' g     S' = Σ f' S^k     dS = Σ f ∂S^k/∂C : dC = α tr(dC) I + β dC
//! ```
//! the first Piola stress is `P = F S + s1 cof F`, and with `dJ_i = cof(F) D_i` a linear tetrahedron of rest volume `V0`
//! has the forces `f_i = -V0 P D_i` and the exact tangent
//! ```text
//! K_ij = V0 { (D_i·S D_j) I                                          geometric
//!           + 2α F D_i (F D_j)ᵀ + β (F D_j (F D_i)ᵀ + (D_i·D_j) F Fᵀ)  material
//!           + s2 dJ_i dJ_jᵀ + s1 ∂²J/∂q_i∂q_j                        volume
//!           + F S' D_i dJ_jᵀ + dJ_i (F S' D_j)ᵀ }                    mixed
//! ∂²J/∂q_i∂q_j = -[F (D_i x D_j)]x  =  -[e_k]x / 6 V0                 (e_k: the deformed edge that is left, with sign)
//! ```
//! Departure from the paper: every `S` is a sum `a I + c C` and `∂S/∂C` is given by the two scalars `α, β`, rather than by
//! tensors stored per element, which serves laws in `I1, I2, J` that are linear in `I2` (all of the paper's isotropic ones
//! but Ogden's, the exponential one included). So a law is a handful of scalars at each strain, is written once over
//! [`Real`], and serves one element or several at once.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};
use pulp::Arch;

pub use super::response::{Isotropic, Response, StrainFactor, VolumeFactor};
use super::{
    Bulk, Lame, Law, MaterialError,
    bulk::UnderPressure,
    kernel::{
        PrincipalLaw, principal::PrincipalResponse, principal_pack, six_pieces_energy, six_pieces_forces,
        six_pieces_pack,
    },
    principal::PrincipalTangent,
};
use crate::{
    element::{ElementMatrices, Tetrahedron},
    lanes::{Real, Vec3, norm_squared},
    pack::{DeformedPack, PackMatrices, Row},
    rotation::{cofactor, signed_svd},
};

/// A law in the multiplicative-Jacobian form. Implementing it gives [`Law`].
pub trait Hyperelastic: Copy + Send + Sync {
    /// Whether a term has both a varying `f` and a varying `g`: `S'` is not zero.
    const MIXED: bool;
    /// Whether a `g` is not linear in `C`: `alpha` or `beta` is not zero.
    const CURVED: bool;
    /// See [`Law::is_continued`].
    const CONTINUED: bool;

    /// Checks the parameters against the law's range.
    fn validate(&self) -> Result<(), MaterialError>;

    /// Lamé parameters at small strain.
    fn small_strain(&self) -> Lame;

    /// See [`Law::relaxed`].
    fn relaxed(&self, share: f64) -> Self;

    /// See [`Law::without_bulk`].
    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        None
    }

    /// The sums over the terms at `I1 = tr C`, `I2 = (I1² - tr C²) / 2` with `C = FᵀF`, and `J = det F`, which is any real
    /// number. Implementations are `#[inline(always)]`, so that they become part of kernels of every vector width.
    fn response<T: Real>(&self, I1: T, I2: T, J: T) -> Response<T>;
}

/// The sums over the terms at `F`, and the tensor `S` at `C`.
#[inline]
fn response_at<L: Hyperelastic>(law: &L, F: &Matrix3<f64>, cof: &Matrix3<f64>) -> (Response<f64>, Matrix3<f64>) {
    let C = F.transpose() * F;
    // The sum of the principal minors of C is the squared norm of the cofactors of F.
    let r = law.response(C.trace(), cof.norm_squared(), F.determinant());
    (r, r.S.at(&C))
}

impl<L: Hyperelastic> Law for L {
    fn validate(&self) -> Result<(), MaterialError> {
        Hyperelastic::validate(self)
    }

    fn small_strain(&self) -> Lame {
        Hyperelastic::small_strain(self)
    }

    fn relaxed(&self, share: f64) -> Self {
        Hyperelastic::relaxed(self, share)
    }

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        Hyperelastic::without_bulk(self)
    }

    fn is_continued(&self) -> bool {
        L::CONTINUED
    }

    #[inline]
    fn element_under_pressure(
        &self,
        element: &Tetrahedron,
        edges: &Matrix3<f64>,
        pressure: f64,
        filter: bool,
        out: &mut ElementMatrices,
    ) -> Option<bool> {
        Some(UnderPressure { law: *self, pressure }.element(element, edges, filter, out))
    }

    fn energy_density(&self, F: &Matrix3<f64>) -> f64 {
        response_at(self, F, &cofactor(F)).0.energy
    }

    #[inline]
    fn first_piola(&self, F: &Matrix3<f64>) -> Matrix3<f64> {
        let cof = cofactor(F);
        let (r, S) = response_at(self, F, &cof);
        F * S + cof * r.s1
    }

    #[inline]
    fn element(&self, element: &Tetrahedron, edges: &Matrix3<f64>, filter: bool, out: &mut ElementMatrices) -> bool {
        let F = edges * element.inverse_rest_edges;
        let cof = cofactor(&F);
        let (r, S) = response_at(self, &F, &cof);
        out.forces = element.forces(&(F * S + cof * r.s1));
        if filter {
            let mut tangent = principal_tangent(self, &F);
            if tangent.filter() {
                tangent.blocks(element, &mut out.blocks);
                return true;
            }
        }
        six_pieces::<L>(element, edges, &F, &cof, &r, &mut out.blocks);
        false
    }

    fn pack(&self, at: &DeformedPack<'_>, filter: bool, out: &mut PackMatrices) {
        if filter {
            principal_pack(Arch::new(), self, at, true, out);
        } else {
            six_pieces_pack(Arch::new(), self, at, out);
        }
    }

    fn pack_forces(&self, at: &DeformedPack<'_>, out: &mut PackMatrices) {
        six_pieces_forces(Arch::new(), self, at, out);
    }

    fn pack_energies(&self, at: &DeformedPack<'_>) -> Row {
        six_pieces_energy(Arch::new(), self, at)
    }
}

/// The exact tangent, piece by piece as in the module's documentation.
#[inline]
fn six_pieces<L: Hyperelastic>(
    element: &Tetrahedron,
    edges: &Matrix3<f64>,
    F: &Matrix3<f64>,
    cof: &Matrix3<f64>,
    r: &Response<f64>,
    blocks: &mut [Matrix3<f64>; 6],
) {
    let V0 = element.volume;
    // Columns are D_1, D_2, D_3; dJ_1, dJ_2, dJ_3; F D_1, ...
    let D = element.inverse_rest_edges.transpose();
    let dJ = cof * D;
    let C = F.transpose() * F;
    let geometric = D.transpose() * (r.S.at(&C) * D) * V0;
    let FD = F * D;
    let DD = D.transpose() * D;
    let FF = F * F.transpose();
    let mixed = F * (r.S_prime.at(&C) * D);
    let mut k = 0;
    for i in 0..3 {
        for j in i..3 {
            let dJ_j = dJ.column(j) * V0;
            let mut block = dJ.column(i) * (dJ_j * r.s2).transpose();
            if L::CURVED {
                let FD_j = FD.column(j) * V0;
                block += FD.column(i) * (FD_j * (2.0 * r.alpha)).transpose();
                block += (FD_j * r.beta) * FD.column(i).transpose() + FF * (DD[(i, j)] * V0 * r.beta);
            }
            if L::MIXED {
                block += mixed.column(i) * dJ_j.transpose() + dJ.column(i) * (mixed.column(j) * V0).transpose();
            }
            for c in 0..3 {
                block[(c, c)] += geometric[(i, j)];
            }
            blocks[k] = block;
            k += 1;
        }
    }
    // V0 s1 ∂²J/∂q_i∂q_j: D_1 x D_2 = E_3 / 6 V0 and its cyclic permutations.
    let s = r.s1 / 6.0;
    subtract_skew(&mut blocks[1], &(edges.column(2) * s));
    subtract_skew(&mut blocks[2], &(edges.column(1) * -s));
    subtract_skew(&mut blocks[4], &(edges.column(0) * s));
}

/// `block -= [w]x`, with `[w]x u = w x u`.
#[inline]
fn subtract_skew(block: &mut Matrix3<f64>, w: &Vector3<f64>) {
    block[(0, 1)] += w.z;
    block[(1, 0)] -= w.z;
    block[(0, 2)] -= w.y;
    block[(2, 0)] += w.y;
    block[(1, 2)] += w.x;
    block[(2, 1)] -= w.x;
}

/// The tangent `∂P/∂F` in the principal frame of `F`, where it falls into small blocks for every isotropic law.
fn principal_tangent<L: Hyperelastic>(law: &L, F: &Matrix3<f64>) -> PrincipalTangent {
    let svd = signed_svd(F);
    PrincipalTangent::new(svd, &law.principal(svd.sigma.as_ref()))
}

impl<L: Hyperelastic> PrincipalLaw for L {
    #[inline(always)]
    fn principal<T: Real>(&self, s: &Vec3<T>) -> PrincipalResponse<T> {
        let square = [s[0] * s[0], s[1] * s[1], s[2] * s[2]];
        let dJ = [s[1] * s[2], s[2] * s[0], s[0] * s[1]];
        let r = self.response(square[0] + square[1] + square[2], norm_squared(&dJ), s[0] * dJ[0]);
        let at = |S: &Isotropic<T>, a: usize| S.identity + S.strain * square[a];
        let S = [at(&r.S, 0), at(&r.S, 1), at(&r.S, 2)];
        let mixed = [s[0] * at(&r.S_prime, 0), s[1] * at(&r.S_prime, 1), s[2] * at(&r.S_prime, 2)];
        let (mut stress, mut flip, mut twist) = (*s, *s, *s);
        let mut scaling = [r.s1; 6];
        let mut k = 0;
        for a in 0..3 {
            stress[a] = s[a] * S[a] + r.s1 * dJ[a];
            for e in a..3 {
                let mut entry = r.s2 * dJ[a] * dJ[e];
                if L::CURVED {
                    entry = entry + (r.alpha + r.alpha) * s[a] * s[e];
                }
                if L::MIXED {
                    entry = entry + mixed[a] * dJ[e] + dJ[a] * mixed[e];
                }
                scaling[k] = entry + if a == e { S[a] + (r.beta + r.beta) * square[a] } else { r.s1 * s[3 - a - e] };
                k += 1;
            }
            // Pair (b, c): an isotropic law has S_b + β σ_c² = S_c + β σ_b²; the mean halves the rounding.
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            let shear = (S[b] + S[c] + r.beta * (square[b] + square[c])) * 0.5;
            let coupling = r.beta * s[b] * s[c] - r.s1 * s[a];
            flip[a] = shear + coupling;
            twist[a] = shear - coupling;
        }
        PrincipalResponse { stress, scaling, flip, twist }
    }
}
