//! What a law in the multiplicative-Jacobian form answers at a strain, put together term by term (letters as in
//! [`hyperelastic`](super::hyperelastic)).

#![allow(non_snake_case)]

use nalgebra::Matrix3;

use crate::lanes::Real;

/// A factor `f(J)` with its derivatives by `J`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeFactor<T> {
    /// `f`.
    pub value: T,
    /// `f'`.
    pub first: T,
    /// `f''`.
    pub second: T,
}

/// A symmetric tensor `identity I + strain C`: the form of `2 ∂g/∂C` for every `g` of `I1` and `I2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Isotropic<T> {
    /// Coefficient of the identity.
    pub identity: T,
    /// Coefficient of `C`.
    pub strain: T,
}

impl Isotropic<f64> {
    /// The tensor at `C`.
    #[inline]
    pub fn at(&self, C: &Matrix3<f64>) -> Matrix3<f64> {
        let mut tensor = C * self.strain;
        for c in 0..3 {
            tensor[(c, c)] += self.identity;
        }
        tensor
    }
}

/// A factor `g(I1, I2)` with its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrainFactor<T> {
    /// `g`.
    pub value: T,
    /// `S = 2 ∂g/∂C`.
    pub S: Isotropic<T>,
    /// Coefficient of `dS = alpha tr(dC) I + beta dC`.
    pub alpha: T,
    /// Coefficient of `dS = alpha tr(dC) I + beta dC`.
    pub beta: T,
}

/// The sums over the terms of a law at one strain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response<T> {
    /// `Ψ = Σ f g` (J/m³).
    pub energy: T,
    /// `S = Σ f S^k` (Pa).
    pub S: Isotropic<T>,
    /// `S' = Σ f' S^k` (Pa).
    pub S_prime: Isotropic<T>,
    /// `s1 = Σ f' g` (Pa).
    pub s1: T,
    /// `s2 = Σ f'' g` (Pa).
    pub s2: T,
    /// `Σ f α` (Pa).
    pub alpha: T,
    /// `Σ f β` (Pa).
    pub beta: T,
}

impl<T: Real> Response<T> {
    /// The term `f(J)`.
    #[inline(always)]
    pub fn volume(f: &VolumeFactor<T>) -> Self {
        let zero = f.value.constant(0.0);
        let none = Isotropic { identity: zero, strain: zero };
        Self { energy: f.value, S: none, S_prime: none, s1: f.first, s2: f.second, alpha: zero, beta: zero }
    }

    /// Adds the term `f(J) g(I1, I2)`.
    #[inline(always)]
    pub fn with(self, f: &VolumeFactor<T>, g: &StrainFactor<T>) -> Self {
        let add = |S: Isotropic<T>, factor: T| Isotropic {
            identity: S.identity + g.S.identity * factor,
            strain: S.strain + g.S.strain * factor,
        };
        Self {
            energy: self.energy + f.value * g.value,
            S: add(self.S, f.value),
            S_prime: add(self.S_prime, f.first),
            s1: self.s1 + f.first * g.value,
            s2: self.s2 + f.second * g.value,
            alpha: self.alpha + f.value * g.alpha,
            beta: self.beta + f.value * g.beta,
        }
    }

    /// Adds the term `g(I1, I2)`, whose `f` is 1.
    #[inline(always)]
    pub fn with_strain(self, g: &StrainFactor<T>) -> Self {
        let S = Isotropic { identity: self.S.identity + g.S.identity, strain: self.S.strain + g.S.strain };
        Self { energy: self.energy + g.value, S, alpha: self.alpha + g.alpha, beta: self.beta + g.beta, ..self }
    }

    /// Adds the term `φ(X)` of `X = f(J) I1 + const`; `phi` holds `φ, φ', φ''` by `X`.
    ///
    /// Exponentials of an invariant do not split into `f(J) g(C)`; since `∂²I1/∂C² = 0`, what `φ''` adds to `∂S/∂C` is
    /// `2 φ'' f² tr(dC) I`, of the form that `alpha` covers.
    #[inline(always)]
    pub fn with_composed(self, phi: &VolumeFactor<T>, f: &VolumeFactor<T>, I1: T) -> Self {
        let (X1, X2) = (f.first * I1, f.second * I1);
        let S = phi.first * f.value * 2.0;
        let S_prime = (phi.first * f.first + phi.second * X1 * f.value) * 2.0;
        Self {
            energy: self.energy + phi.value,
            S: Isotropic { identity: self.S.identity + S, ..self.S },
            S_prime: Isotropic { identity: self.S_prime.identity + S_prime, ..self.S_prime },
            s1: self.s1 + phi.first * X1,
            s2: self.s2 + phi.second * X1 * X1 + phi.first * X2,
            alpha: self.alpha + phi.second * f.value * f.value * 2.0,
            beta: self.beta,
        }
    }

    /// Adds the term `f(J)`.
    #[inline(always)]
    pub fn with_volume(self, f: &VolumeFactor<T>) -> Self {
        Self { energy: self.energy + f.value, s1: self.s1 + f.first, s2: self.s2 + f.second, ..self }
    }
}
