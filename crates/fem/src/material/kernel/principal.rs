//! Forces and tangent in the principal frame of `F`, with the definiteness filter (see
//! [`principal`](crate::material::principal)), for packs of elements.
//!
//! Three passes over a pack: singular values and frames, which no law enters; the derivatives of the law by the singular
//! values; filter and blocks, which no law enters either.

#![allow(non_snake_case)]

use pulp::{Simd, WithSimd};

use super::{
    Dispatch, TRIANGLE,
    frame::{assemble, filter_response, forces},
    jacobian, load3, load6, load33, parts, pressure, store_forces, store3, store33,
};
use crate::{
    lanes::{Lanes, Mat3, Real, Vec3, scaled, signed_svd, transposed_product},
    pack::{DeformedPack, PACK, PackMatrices, Row},
};

/// Derivatives of an isotropic energy by the signed singular values, with the eigenvalues of flips and twists.
#[derive(Clone, Copy, Debug)]
pub struct PrincipalResponse<T> {
    /// `Ψ_a = ∂Ψ/∂σ_a` (Pa).
    pub stress: Vec3<T>,
    /// `∂²Ψ/∂σ_a∂σ_b` (Pa) for the pairs 00, 01, 02, 11, 12, 22.
    pub scaling: [T; 6],
    /// Eigenvalue of the flip of the two axes other than `a` (Pa): `(Ψ_b - Ψ_c) / (σ_b - σ_c)`.
    pub flip: Vec3<T>,
    /// Eigenvalue of the twist of the two axes other than `a` (Pa): `(Ψ_b + Ψ_c) / (σ_b + σ_c)`.
    pub twist: Vec3<T>,
}

impl<T: Real> PrincipalResponse<T> {
    /// Adds the derivatives of `p J`, `J = σ_0 σ_1 σ_2`.
    #[inline(always)]
    fn add_pressure(&mut self, sigma: &Vec3<T>, p: T) {
        let along = scaled(sigma, p);
        for a in 0..3 {
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            self.stress[a] = self.stress[a] + along[b] * sigma[c];
            self.scaling[TRIANGLE[b][c]] = self.scaling[TRIANGLE[b][c]] + along[a];
            self.flip[a] = self.flip[a] - along[a];
            self.twist[a] = self.twist[a] + along[a];
        }
    }
}

/// A law as a function of the signed singular values.
pub trait PrincipalLaw {
    /// Derivatives at singular values with `sigma[0] >= sigma[1] >= |sigma[2]|`.
    fn principal<T: Real>(&self, sigma: &Vec3<T>) -> PrincipalResponse<T>;
}

/// What passes between the three passes over a pack.
#[repr(align(64))]
struct Scratch {
    U: [[Row; 3]; 3],
    V: [[Row; 3]; 3],
    sigma: [Row; 3],
    stress: [Row; 3],
    scaling: [Row; 6],
    flip: [Row; 3],
    twist: [Row; 3],
}

impl Scratch {
    const ZERO: Self = Self {
        U: [[[0.0; PACK]; 3]; 3],
        V: [[[0.0; PACK]; 3]; 3],
        sigma: [[0.0; PACK]; 3],
        stress: [[0.0; PACK]; 3],
        scaling: [[0.0; PACK]; 6],
        flip: [[0.0; PACK]; 3],
        twist: [[0.0; PACK]; 3],
    };
}

/// Forces and tangents of a pack of one law, with or without the filter.
pub(crate) fn principal_pack<L: PrincipalLaw>(
    dispatch: impl Dispatch,
    law: &L,
    at: &DeformedPack<'_>,
    filter: bool,
    out: &mut PackMatrices,
) {
    let mut scratch = Scratch::ZERO;
    let scratch = &mut scratch;
    dispatch.run(Decompose { at, scratch });
    dispatch.run(Respond { law, at, scratch });
    dispatch.run(Assemble { at, filter, scratch, out });
}

/// The forces of [`principal_pack`] alone.
pub(crate) fn principal_forces<L: PrincipalLaw>(
    dispatch: impl Dispatch,
    law: &L,
    at: &DeformedPack<'_>,
    out: &mut PackMatrices,
) {
    let mut scratch = Scratch::ZERO;
    let scratch = &mut scratch;
    dispatch.run(Decompose { at, scratch });
    dispatch.run(Respond { law, at, scratch });
    dispatch.run(Forces { at, scratch, out });
}

/// `F = Σ_k e_k D_kᵀ` and its frames.
struct Decompose<'a> {
    at: &'a DeformedPack<'a>,
    scratch: &'a mut Scratch,
}

impl WithSimd for Decompose<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // The rotations are chains of roots and quotients: where a pack is two vectors, both go side by side.
        if S::F64_LANES == PACK / 2 { self.run::<S, 2>(simd) } else { self.run::<S, 1>(simd) }
    }
}

impl Decompose<'_> {
    #[inline(always)]
    fn run<S: Simd, const N: usize>(self, simd: S) {
        let Self { at, scratch } = self;
        let pack = at.rest;
        for part in 0..parts::<S, N>(pack) {
            let e: Mat3<Lanes<S, N>> = load33(simd, &at.edges, part);
            let D = load33(simd, &pack.shape, part);
            let mut F = e;
            for c in 0..3 {
                for r in 0..3 {
                    F[c][r] = e[0][r] * D[0][c] + e[1][r] * D[1][c] + e[2][r] * D[2][c];
                }
            }
            let frames = signed_svd(&F);
            store33(&frames.U, &mut scratch.U, part);
            store33(&frames.V, &mut scratch.V, part);
            store3(&frames.sigma, &mut scratch.sigma, part);
        }
    }
}

/// The derivatives of the law.
struct Respond<'a, L> {
    law: &'a L,
    at: &'a DeformedPack<'a>,
    scratch: &'a mut Scratch,
}

impl<L: PrincipalLaw> WithSimd for Respond<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { law, at, scratch } = self;
        for part in 0..parts::<S, 1>(at.rest) {
            let sigma: Vec3<Lanes<S>> = load3(simd, &scratch.sigma, part);
            let mut response = law.principal(&sigma);
            if let Some(pressure) = pressure(simd, at, part) {
                response.add_pressure(&sigma, pressure);
            }
            store3(&response.stress, &mut scratch.stress, part);
            for k in 0..6 {
                response.scaling[k].store(&mut scratch.scaling[k], part);
            }
            store3(&response.flip, &mut scratch.flip, part);
            store3(&response.twist, &mut scratch.twist, part);
        }
    }
}

/// Forces alone.
struct Forces<'a> {
    at: &'a DeformedPack<'a>,
    scratch: &'a Scratch,
    out: &'a mut PackMatrices,
}

impl WithSimd for Forces<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { at, scratch, out } = self;
        let pack = at.rest;
        for part in 0..parts::<S, 1>(pack) {
            let (U, V) = (load33(simd, &scratch.U, part), load33(simd, &scratch.V, part));
            let D = load33(simd, &pack.shape, part);
            let g = [transposed_product(&V, &D[0]), transposed_product(&V, &D[1]), transposed_product(&V, &D[2])];
            let e = load33(simd, &at.edges, part);
            let J = jacobian(simd, &e, pack, part);
            let stress = load3(simd, &scratch.stress, part);
            store_forces(&forces(&stress, &U, &g, Lanes::load(simd, &pack.volume, part)), J, out, part);
        }
        out.filtered = [0.0; PACK];
    }
}

/// Filter, forces and blocks.
struct Assemble<'a> {
    at: &'a DeformedPack<'a>,
    filter: bool,
    scratch: &'a Scratch,
    out: &'a mut PackMatrices,
}

impl WithSimd for Assemble<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { at, filter, scratch, out } = self;
        let pack = at.rest;
        for part in 0..parts::<S, 1>(pack) {
            let mut response = PrincipalResponse {
                stress: load3(simd, &scratch.stress, part),
                scaling: load6(simd, &scratch.scaling, part),
                flip: load3(simd, &scratch.flip, part),
                twist: load3(simd, &scratch.twist, part),
            };
            let zero = response.stress[0].constant(0.0);
            let acted = if filter { filter_response(&mut response) } else { zero };
            acted.store(&mut out.filtered, part);

            let (U, V) = (load33(simd, &scratch.U, part), load33(simd, &scratch.V, part));
            let D = load33(simd, &pack.shape, part);
            let g = [transposed_product(&V, &D[0]), transposed_product(&V, &D[1]), transposed_product(&V, &D[2])];
            let e = load33(simd, &at.edges, part);
            let J = jacobian(simd, &e, pack, part);
            assemble(&response, &U, &g, Lanes::load(simd, &pack.volume, part), J).store(out, part);
        }
    }
}
