//! The exact tangent of a hyperelastic law in its six pieces (see [`hyperelastic`](crate::material::hyperelastic)).
//!
//! Written in the deformed edges `e_k` alone: with the Gram matrix `D_i · D_j` of the rest shape
//! ```text
//! F D_i = Σ_k e_k (D_k · D_i)      F Fᵀ = Σ_k e_k (F D_k)ᵀ      dJ_1 = e_2 x e_3 / det E, cyclic      J = e_1 · dJ_1
//! D_i·S D_j = a (D_i·D_j) + c (F D_i)·(F D_j)      F S D_i = a F D_i + c (F Fᵀ) F D_i      for S = a I + c C
//! ```
//! so that neither `F` nor the shape vectors are formed.

#![allow(non_snake_case)]

use pulp::{Simd, WithSimd};

use super::{Dispatch, Free, TRIANGLE, load6, load33, parts, pressure, store_forces};
use crate::{
    lanes::{Lanes, Mat3, Real, Vec3, cross, dot, scaled, sum},
    material::hyperelastic::{Hyperelastic, Isotropic, Response},
    pack::{DeformedPack, PACK, Pack, PackMatrices, Row},
};

/// Forces and exact tangents of a pack of one law.
pub(crate) fn six_pieces_pack<L: Hyperelastic>(
    dispatch: impl Dispatch,
    law: &L,
    at: &DeformedPack<'_>,
    out: &mut PackMatrices,
) {
    dispatch.run(SixPieces { law, at, out });
}

/// The forces of [`six_pieces_pack`] alone.
pub(crate) fn six_pieces_forces<L: Hyperelastic>(
    dispatch: impl Dispatch,
    law: &L,
    at: &DeformedPack<'_>,
    out: &mut PackMatrices,
) {
    dispatch.run(Forces { law, at, out });
}

/// Energies of the elements of a pack of one law (J).
pub(crate) fn six_pieces_energy<L: Hyperelastic>(dispatch: impl Dispatch, law: &L, at: &DeformedPack<'_>) -> Row {
    dispatch.run(Energy { law, at })
}

struct Forces<'a, L> {
    law: &'a L,
    at: &'a DeformedPack<'a>,
    out: &'a mut PackMatrices,
}

impl<L: Hyperelastic> WithSimd for Forces<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { law, at, out } = self;
        let pack = at.rest;
        for part in 0..parts::<S, 1>(pack) {
            let shape = Shape::load(simd, pack, part);
            let strain = Strain::new(&load33(simd, &at.edges, part), &shape);
            let r = response(law, &strain, pressure(simd, at, part));
            store_forces(&strain.with(&shape, &r).forces::<L>(), strain.J, out, part);
        }
        out.filtered = [0.0; 8];
    }
}

struct Energy<'a, L> {
    law: &'a L,
    at: &'a DeformedPack<'a>,
}

impl<L: Hyperelastic> WithSimd for Energy<'_, L> {
    type Output = Row;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Row {
        let Self { law, at } = self;
        let pack = at.rest;
        let mut energies = [0.0; PACK];
        for part in 0..parts::<S, 1>(pack) {
            let shape = Shape::load(simd, pack, part);
            let strain = Strain::new(&load33(simd, &at.edges, part), &shape);
            let r = response(law, &strain, pressure(simd, at, part));
            (r.energy * shape.V0).store(&mut energies, part);
        }
        energies
    }
}

struct SixPieces<'a, L> {
    law: &'a L,
    at: &'a DeformedPack<'a>,
    out: &'a mut PackMatrices,
}

impl<L: Hyperelastic> WithSimd for SixPieces<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { law, at, out } = self;
        let pack = at.rest;
        for part in 0..parts::<S, 1>(pack) {
            let (e, shape) = (load33(simd, &at.edges, part), Shape::load(simd, pack, part));
            six_pieces(law, &e, &shape, pressure(simd, at, part)).store(out, part);
        }
        out.filtered = [0.0; 8];
    }
}

/// What the pieces need of an element at rest.
struct Shape<T> {
    /// Triangle of `D_i · D_j`.
    gram: [T; 6],
    inverse_det: T,
    V0: T,
}

impl<S: Simd> Shape<Lanes<S>> {
    #[inline(always)]
    fn load(simd: S, pack: &Pack, part: usize) -> Self {
        Self {
            gram: load6(simd, &pack.gram, part),
            inverse_det: Lanes::load(simd, &pack.inverse_det, part),
            V0: Lanes::load(simd, &pack.volume, part),
        }
    }
}

/// What the law and the pieces need of a deformed element.
struct Strain<T> {
    dJ: Mat3<T>,
    FD: Mat3<T>,
    /// Triangle of `F Fᵀ`.
    FF: [T; 6],
    I1: T,
    I2: T,
    J: T,
}

impl<T: Real> Strain<T> {
    #[inline(always)]
    fn new(e: &Mat3<T>, shape: &Shape<T>) -> Self {
        let Shape { gram, inverse_det, .. } = *shape;
        let dJ = [
            scaled(&cross(&e[1], &e[2]), inverse_det),
            scaled(&cross(&e[2], &e[0]), inverse_det),
            scaled(&cross(&e[0], &e[1]), inverse_det),
        ];
        let J = dot(&e[0], &dJ[0]);
        let mut FD = *e;
        for i in 0..3 {
            for c in 0..3 {
                FD[i][c] =
                    e[0][c] * gram[TRIANGLE[0][i]] + e[1][c] * gram[TRIANGLE[1][i]] + e[2][c] * gram[TRIANGLE[2][i]];
            }
        }
        let mut FF = gram;
        for c in 0..3 {
            for r in c..3 {
                FF[TRIANGLE[r][c]] = e[0][r] * FD[0][c] + e[1][r] * FD[1][c] + e[2][r] * FD[2][c];
            }
        }
        let I1 = FF[0] + FF[3] + FF[5];
        // Sum of the principal minors of F Fᵀ.
        let I2 = (FF[0] * FF[3] - FF[1] * FF[1]) + (FF[0] * FF[5] - FF[2] * FF[2]) + (FF[3] * FF[5] - FF[4] * FF[4]);
        Self { dJ, FD, FF, I1, I2, J }
    }

    /// The element with the response of its law.
    #[inline(always)]
    fn with<'a>(&'a self, shape: &'a Shape<T>, r: &'a Response<T>) -> Deformed<'a, T> {
        Deformed { dJ: &self.dJ, FD: &self.FD, FF: &self.FF, gram: &shape.gram, r, V0: shape.V0 }
    }
}

/// What the law answers, under a pressure or none.
#[inline(always)]
fn response<T: Real, L: Hyperelastic>(law: &L, strain: &Strain<T>, pressure: Option<T>) -> Response<T> {
    let mut r = law.response(strain.I1, strain.I2, strain.J);
    if let Some(p) = pressure {
        r.energy = r.energy + p * strain.J;
        r.s1 = r.s1 + p;
    }
    r
}

#[inline(always)]
fn six_pieces<T: Real, L: Hyperelastic>(law: &L, e: &Mat3<T>, shape: &Shape<T>, pressure: Option<T>) -> Free<T> {
    let strain = Strain::new(e, shape);
    let r = response(law, &strain, pressure);
    let at = strain.with(shape, &r);
    let forces = at.forces::<L>();
    // V0 s1 ∂²J/∂q_i∂q_j: D_1 x D_2 = E_3 / det E and its cyclic permutations.
    let s = r.s1 * shape.V0 * shape.inverse_det;
    let off_diagonal = [
        subtract_skew(at.block::<L>(0, 1), &scaled(&e[2], s)),
        subtract_skew(at.block::<L>(0, 2), &scaled(&e[1], -s)),
        subtract_skew(at.block::<L>(1, 2), &scaled(&e[0], s)),
    ];
    let diagonal = [at.triangle::<L>(0), at.triangle::<L>(1), at.triangle::<L>(2)];
    Free { forces, diagonal, off_diagonal, jacobian: strain.J }
}

/// A deformed element with the response of its law.
struct Deformed<'a, T> {
    dJ: &'a Mat3<T>,
    FD: &'a Mat3<T>,
    /// Triangle of `F Fᵀ`.
    FF: &'a [T; 6],
    gram: &'a [T; 6],
    r: &'a Response<T>,
    V0: T,
}

impl<T: Real> Deformed<'_, T> {
    /// `-V0 P D_i`.
    #[inline(always)]
    fn forces<L: Hyperelastic>(&self) -> Mat3<T> {
        let minus_V0 = -self.V0;
        let mut forces = *self.dJ;
        for i in 0..3 {
            let along = self.stretched::<L>(&self.r.S, i);
            forces[i] = scaled(&sum(&along, &scaled(&self.dJ[i], self.r.s1)), minus_V0);
        }
        forces
    }

    /// `F S D_i`.
    #[inline(always)]
    fn stretched<L: Hyperelastic>(&self, S: &Isotropic<T>, i: usize) -> Vec3<T> {
        let (v, FF) = (&self.FD[i], self.FF);
        let along = scaled(v, S.identity);
        if !L::CURVED {
            return along;
        }
        let through = [
            FF[0] * v[0] + FF[1] * v[1] + FF[2] * v[2],
            FF[1] * v[0] + FF[3] * v[1] + FF[4] * v[2],
            FF[2] * v[0] + FF[4] * v[1] + FF[5] * v[2],
        ];
        sum(&along, &scaled(&through, S.strain))
    }

    /// Block `K_ij` without its skew part.
    #[inline(always)]
    fn block<L: Hyperelastic>(&self, i: usize, j: usize) -> Mat3<T> {
        let Self { dJ, FD, FF, gram, r, V0 } = *self;
        // (s2 dJ_i + F S' D_i) dJ_jᵀ + dJ_i (F S' D_j)ᵀ.
        let mut left = scaled(&dJ[i], r.s2 * V0);
        let mut mixed = left;
        if L::MIXED {
            left = sum(&left, &scaled(&self.stretched::<L>(&r.S_prime, i), V0));
            mixed = scaled(&self.stretched::<L>(&r.S_prime, j), V0);
        }
        let mut geometric = r.S.identity * gram[TRIANGLE[i][j]];
        if L::CURVED {
            geometric = geometric + r.S.strain * dot(&FD[i], &FD[j]);
        }
        let geometric = geometric * V0;
        let alpha = scaled(&FD[i], (r.alpha + r.alpha) * V0);
        let beta = scaled(&FD[j], r.beta * V0);
        let beta_gram = r.beta * V0 * gram[TRIANGLE[i][j]];
        let mut block = *dJ;
        for c in 0..3 {
            for k in 0..3 {
                let mut entry = left[k] * dJ[j][c];
                if L::MIXED {
                    entry = entry + dJ[i][k] * mixed[c];
                }
                if L::CURVED {
                    entry = entry + alpha[k] * FD[j][c] + beta[k] * FD[i][c] + beta_gram * FF[TRIANGLE[k][c]];
                }
                block[c][k] = if k == c { entry + geometric } else { entry };
            }
        }
        block
    }

    /// Triangle of the block `K_ii`.
    #[inline(always)]
    fn triangle<L: Hyperelastic>(&self, i: usize) -> [T; 6] {
        let b = self.block::<L>(i, i);
        [b[0][0], b[0][1], b[0][2], b[1][1], b[1][2], b[2][2]]
    }
}

/// `block - [w]x`, with `[w]x u = w x u`.
#[inline(always)]
fn subtract_skew<T: Real>(mut block: Mat3<T>, w: &[T; 3]) -> Mat3<T> {
    block[1][0] = block[1][0] + w[2];
    block[0][1] = block[0][1] - w[2];
    block[2][0] = block[2][0] - w[1];
    block[0][2] = block[0][2] + w[1];
    block[2][1] = block[2][1] + w[0];
    block[1][2] = block[1][2] - w[0];
    block
}
