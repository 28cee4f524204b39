//! Forces and the constant tangent of linear elasticity (see [`linear`](crate::material::linear)) for packs of elements.

#![allow(non_snake_case)]

use pulp::{Simd, WithSimd};

use super::{Dispatch, Free, TRIANGLE, jacobian, load6, load33, parts, store_forces};
use crate::{
    lanes::{Lanes, Mat3, Real, matrix_product, scaled},
    material::Lame,
    pack::{DeformedPack, PACK, PackMatrices},
};

/// Forces and tangents of a pack of linear elasticity; pressures are ignored.
pub(crate) fn small_strain_pack(dispatch: impl Dispatch, lame: Lame, at: &DeformedPack<'_>, out: &mut PackMatrices) {
    dispatch.run(SmallStrain { lame, at, out });
}

/// The forces of [`small_strain_pack`] alone.
pub(crate) fn small_strain_forces(dispatch: impl Dispatch, lame: Lame, at: &DeformedPack<'_>, out: &mut PackMatrices) {
    dispatch.run(Forces { lame, at, out });
}

struct Forces<'a> {
    lame: Lame,
    at: &'a DeformedPack<'a>,
    out: &'a mut PackMatrices,
}

impl WithSimd for Forces<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lame, at, out } = self;
        let pack = at.rest;
        for part in 0..parts::<S, 1>(pack) {
            let e = load33(simd, &at.edges, part);
            let D = load33(simd, &pack.shape, part);
            let J = jacobian(simd, &e, pack, part);
            let V0: Lanes<S> = Lanes::load(simd, &pack.volume, part);
            store_forces(&forces(&e, &D, V0 * lame.mu, V0 * lame.lambda), J, out, part);
        }
        out.filtered = [0.0; PACK];
    }
}

struct SmallStrain<'a> {
    lame: Lame,
    at: &'a DeformedPack<'a>,
    out: &'a mut PackMatrices,
}

impl WithSimd for SmallStrain<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lame, at, out } = self;
        let pack = at.rest;
        for part in 0..parts::<S, 1>(pack) {
            let e = load33(simd, &at.edges, part);
            let D = load33(simd, &pack.shape, part);
            let gram = load6(simd, &pack.gram, part);
            let J = jacobian(simd, &e, pack, part);
            small_strain(lame, &e, &D, &gram, Lanes::load(simd, &pack.volume, part), J).store(out, part);
        }
        out.filtered = [0.0; PACK];
    }
}

#[inline(always)]
fn small_strain<T: Real>(lame: Lame, e: &Mat3<T>, D: &Mat3<T>, gram: &[T; 6], V0: T, J: T) -> Free<T> {
    let (mu, lambda) = (V0 * lame.mu, V0 * lame.lambda);
    let forces = forces(e, D, mu, lambda);
    let (d1, d2, d3) =
        (block(D, gram, mu, lambda, 0, 0), block(D, gram, mu, lambda, 1, 1), block(D, gram, mu, lambda, 2, 2));
    Free {
        forces,
        diagonal: [triangle(&d1), triangle(&d2), triangle(&d3)],
        off_diagonal: [
            block(D, gram, mu, lambda, 0, 1),
            block(D, gram, mu, lambda, 0, 2),
            block(D, gram, mu, lambda, 1, 2),
        ],
        jacobian: J,
    }
}

/// `-V0 P D_i`, with the moduli times `V0`.
#[inline(always)]
fn forces<T: Real>(e: &Mat3<T>, D: &Mat3<T>, mu: T, lambda: T) -> Mat3<T> {
    // V0 P by columns, from the displacement gradient G = F - I.
    let mut G = *e;
    for c in 0..3 {
        for r in 0..3 {
            G[c][r] = e[0][r] * D[0][c] + e[1][r] * D[1][c] + e[2][r] * D[2][c];
        }
        G[c][c] = G[c][c] - 1.0;
    }
    let pressure = (G[0][0] + G[1][1] + G[2][2]) * lambda;
    let mut P = G;
    for c in 0..3 {
        for r in 0..3 {
            P[c][r] = (G[c][r] + G[r][c]) * mu;
        }
        P[c][c] = P[c][c] + pressure;
    }
    let mut forces = *e;
    for i in 0..3 {
        forces[i] = scaled(&matrix_product(&P, &D[i]), mu.constant(-1.0));
    }
    forces
}

/// `K_ij = V0 (μ (D_i·D_j I + D_j D_iᵀ) + λ D_i D_jᵀ)`, with the moduli times `V0`.
#[inline(always)]
fn block<T: Real>(D: &Mat3<T>, gram: &[T; 6], mu: T, lambda: T, i: usize, j: usize) -> Mat3<T> {
    let mut block = *D;
    for c in 0..3 {
        for r in 0..3 {
            block[c][r] = D[j][r] * D[i][c] * mu + D[i][r] * D[j][c] * lambda;
        }
        block[c][c] = block[c][c] + gram[TRIANGLE[i][j]] * mu;
    }
    block
}

#[inline(always)]
fn triangle<T: Real>(b: &Mat3<T>) -> [T; 6] {
    [b[0][0], b[0][1], b[0][2], b[1][1], b[1][2], b[2][2]]
}
