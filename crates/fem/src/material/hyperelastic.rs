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
//! Departure from the paper: `∂S/∂C` is given at each strain by the two scalars `α, β` rather than by tensors stored per
//! element, which serves laws in `I1, I2, J` that are linear in `I2` (all of the paper's isotropic ones but Ogden's, the
//! exponential one included) and keeps the elements small.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use super::{Bulk, Lame, Law, MaterialError, bulk::UnderPressure, principal::PrincipalTangent};
use crate::{
    element::{ElementMatrices, Tetrahedron},
    rotation::{cofactor, signed_svd},
};

/// A factor `f(J)` with its derivatives by `J`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VolumeFactor {
    /// `f`.
    pub value: f64,
    /// `f'`.
    pub first: f64,
    /// `f''`.
    pub second: f64,
}

impl VolumeFactor {
    /// `f = 1`.
    pub const ONE: Self = Self { value: 1.0, first: 0.0, second: 0.0 };
}

/// A factor `g(C)` with its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StrainFactor {
    /// `g`.
    pub value: f64,
    /// `S = 2 ∂g/∂C`, symmetric.
    pub S: Matrix3<f64>,
    /// Coefficient of `dS = alpha tr(dC) I + beta dC`.
    pub alpha: f64,
    /// Coefficient of `dS = alpha tr(dC) I + beta dC`.
    pub beta: f64,
}

/// The sums over the terms of a law at one strain.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    /// `Ψ = Σ f g` (J/m³).
    pub energy: f64,
    /// `S = Σ f S^k` (Pa).
    pub S: Matrix3<f64>,
    /// `S' = Σ f' S^k` (Pa).
    pub S_prime: Matrix3<f64>,
    /// `s1 = Σ f' g` (Pa).
    pub s1: f64,
    /// `s2 = Σ f'' g` (Pa).
    pub s2: f64,
    /// `Σ f α` (Pa).
    pub alpha: f64,
    /// `Σ f β` (Pa).
    pub beta: f64,
}

impl Response {
    /// Adds the term `f(J) g(C)`.
    #[inline]
    pub fn add(&mut self, f: &VolumeFactor, g: &StrainFactor) {
        self.energy += f.value * g.value;
        self.S += g.S * f.value;
        self.S_prime += g.S * f.first;
        self.s1 += f.first * g.value;
        self.s2 += f.second * g.value;
        self.alpha += f.value * g.alpha;
        self.beta += f.value * g.beta;
    }

    /// Adds the term `φ(X)` of `X = f(J) I1 + const`, with `I1 = trace`; `phi` holds `φ, φ', φ''` by `X`.
    ///
    /// Exponentials of an invariant do not split into `f(J) g(C)`; since `∂²I1/∂C² = 0`, what `φ''` adds to `∂S/∂C` is
    /// `2 φ'' f² tr(dC) I`, of the form that `alpha` covers.
    #[inline]
    pub fn add_composed(&mut self, phi: &VolumeFactor, f: &VolumeFactor, trace: f64) {
        let (X1, X2) = (f.first * trace, f.second * trace);
        self.energy += phi.value;
        let S = 2.0 * phi.first * f.value;
        let S_prime = 2.0 * (phi.first * f.first + phi.second * X1 * f.value);
        for c in 0..3 {
            self.S[(c, c)] += S;
            self.S_prime[(c, c)] += S_prime;
        }
        self.s1 += phi.first * X1;
        self.s2 += phi.second * X1 * X1 + phi.first * X2;
        self.alpha += 2.0 * phi.second * f.value * f.value;
    }

    /// Adds the term `f(J)`.
    #[inline]
    pub fn add_volume(&mut self, f: &VolumeFactor) {
        self.energy += f.value;
        self.s1 += f.first;
        self.s2 += f.second;
    }
}

/// A law in the multiplicative-Jacobian form. Implementing it gives [`Law`].
pub trait Hyperelastic: Copy + Send + Sync {
    /// Whether a term has both a varying `f` and a varying `g`: `S'` is not zero.
    const MIXED: bool;
    /// Whether a `g` is not linear in `C`: `alpha` or `beta` is not zero.
    const CURVED: bool;

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

    /// The sums over the terms at `C = FᵀF` and `J = det F`, which is any real number.
    fn response(&self, C: &Matrix3<f64>, J: f64) -> Response;
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
        self.response(&(F.transpose() * F), F.determinant()).energy
    }

    #[inline]
    fn first_piola(&self, F: &Matrix3<f64>) -> Matrix3<f64> {
        let r = self.response(&(F.transpose() * F), F.determinant());
        F * r.S + cofactor(F) * r.s1
    }

    #[inline]
    fn element(&self, element: &Tetrahedron, edges: &Matrix3<f64>, filter: bool, out: &mut ElementMatrices) -> bool {
        let F = edges * element.inverse_rest_edges;
        let cof = cofactor(&F);
        let r = self.response(&(F.transpose() * F), F.determinant());
        out.forces = element.forces(&(F * r.S + cof * r.s1));
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
}

/// The exact tangent, piece by piece as in the module's documentation.
#[inline]
fn six_pieces<L: Hyperelastic>(
    element: &Tetrahedron,
    edges: &Matrix3<f64>,
    F: &Matrix3<f64>,
    cof: &Matrix3<f64>,
    r: &Response,
    blocks: &mut [Matrix3<f64>; 6],
) {
    let V0 = element.volume;
    // Columns are D_1, D_2, D_3; dJ_1, dJ_2, dJ_3; F D_1, ...
    let D = element.inverse_rest_edges.transpose();
    let dJ = cof * D;
    let geometric = D.transpose() * (r.S * D) * V0;
    let FD = F * D;
    let DD = D.transpose() * D;
    let FF = F * F.transpose();
    let mixed = F * (r.S_prime * D);
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
    let s = svd.sigma;
    let r = law.response(&Matrix3::from_diagonal(&s.component_mul(&s)), s.x * s.y * s.z);
    let dJ = Vector3::new(s.y * s.z, s.z * s.x, s.x * s.y);
    let mut tangent = PrincipalTangent::new(svd);
    for a in 0..3 {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        for e in 0..3 {
            tangent.scaling[(a, e)] = r.s2 * dJ[a] * dJ[e]
                + 2.0 * r.alpha * s[a] * s[e]
                + s[a] * r.S_prime[(a, a)] * dJ[e]
                + dJ[a] * s[e] * r.S_prime[(e, e)];
        }
        tangent.scaling[(a, a)] += r.S[(a, a)] + 2.0 * r.beta * s[a] * s[a];
        tangent.scaling[(a, b)] += r.s1 * s[c];
        tangent.scaling[(a, c)] += r.s1 * s[b];
        // Pair (b, c): an isotropic law has S_b + β σ_c² = S_c + β σ_b²; the mean halves the rounding.
        let shear = 0.5 * (r.S[(b, b)] + r.S[(c, c)] + r.beta * (s[b] * s[b] + s[c] * s[c]));
        let coupling = r.beta * s[b] * s[c] - r.s1 * s[a];
        tangent.flip[a] = shear + coupling;
        tangent.twist[a] = shear - coupling;
    }
    tangent
}
