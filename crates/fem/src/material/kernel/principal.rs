//! Forces and tangent in the principal frame of `F`, with the definiteness filter (see
//! [`principal`](crate::material::principal)), for packs of elements.
//!
//! Three passes over a pack: singular values and frames, which no law enters; the derivatives of the law by the singular
//! values; filter and blocks, which no law enters either.

#![allow(non_snake_case)]

use pulp::{Simd, WithSimd};

use super::{Dispatch, Free, TRIANGLE, jacobian, load3, load6, load33, parts, pressure, store_forces, store3, store33};
use crate::{
    lanes::{Lanes, Mat3, Real, Vec3, eigenvectors, matrix_product, scaled, signed_svd, transposed_product},
    material::principal::ROUNDING,
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

/// `-V0 U Σ g_i` with the principal stresses `Σ`.
#[inline(always)]
fn forces<T: Real>(stress: &Vec3<T>, U: &Mat3<T>, g: &Mat3<T>, V0: T) -> Mat3<T> {
    let stress = scaled(stress, -V0);
    let mut forces = *g;
    for i in 0..3 {
        forces[i] = matrix_product(U, &[stress[0] * g[i][0], stress[1] * g[i][1], stress[2] * g[i][2]]);
    }
    forces
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

/// Replaces negative eigenvalues by zero. Returns 1 where one was negative beyond rounding, elsewhere 0.
///
/// NaN stays NaN; where an eigenvalue is infinite nothing counts as negative beyond rounding.
#[inline(always)]
fn filter_response<T: Real>(response: &mut PrincipalResponse<T>) -> T {
    let (zero, one) = (response.flip[0].constant(0.0), response.flip[0].constant(1.0));
    let mut scale = zero;
    for x in response.scaling.iter().chain(&response.flip).chain(&response.twist) {
        scale = x.abs().larger(scale);
    }
    let rounding = scale * ROUNDING;
    let mut acted = zero;
    for x in response.flip.iter_mut().chain(&mut response.twist) {
        acted = one.or_where_not((-*x).above(rounding), acted);
        *x = zero.or_where_not(zero.above(*x), *x);
    }

    // Positive definite by its leading minors.
    let A = &mut response.scaling;
    let minor = A[0] * A[3] - A[1] * A[1];
    let det = A[5] * minor + A[4] * (A[1] * A[2] - A[0] * A[4]) + A[2] * (A[1] * A[4] - A[3] * A[2]);
    let indefinite = zero.or_where_not(A[0].above(zero), one);
    let indefinite = indefinite.or_where_not(minor.above(zero), one);
    let indefinite = indefinite.or_where_not(det.above(zero), one);
    let indefinite = indefinite.above(zero);
    if zero.any(indefinite) {
        let (values, vectors) = eigenvectors([A[0], A[3], A[5]], [A[4], A[2], A[1]]);
        let mut lifted = vectors;
        for a in 0..3 {
            let missing = zero.or_where_not(values[a].above(zero), -values[a]);
            lifted[a] = scaled(&vectors[a], missing.or_where_not(indefinite, zero));
        }
        let mut change = zero;
        for c in 0..3 {
            for r in c..3 {
                let add = lifted[0][r] * vectors[0][c] + lifted[1][r] * vectors[1][c] + lifted[2][r] * vectors[2][c];
                change = add.abs().larger(change);
                A[TRIANGLE[r][c]] = A[TRIANGLE[r][c]] + add;
            }
        }
        acted = one.or_where_not(change.above(rounding), acted);
    }
    acted
}

/// Forces and blocks from the derivatives in the frames: `U`, and `g_i = Vᵀ D_i`.
#[inline(always)]
fn assemble<T: Real>(response: &PrincipalResponse<T>, U: &Mat3<T>, g: &Mat3<T>, V0: T, J: T) -> Free<T> {
    let forces = forces(&response.stress, U, g, V0);
    let half = V0 * 0.5;
    let (mut shear, mut coupling) = (response.flip, response.flip);
    for a in 0..3 {
        shear[a] = (response.flip[a] + response.twist[a]) * half;
        coupling[a] = (response.flip[a] - response.twist[a]) * half;
    }
    let mut A = response.scaling;
    for x in &mut A {
        *x = *x * V0;
    }
    let frame = Frame { U, A: &A, shear: &shear, coupling: &coupling };
    Free {
        forces,
        diagonal: [frame.triangle(&g[0]), frame.triangle(&g[1]), frame.triangle(&g[2])],
        off_diagonal: [frame.block(&g[0], &g[1]), frame.block(&g[0], &g[2]), frame.block(&g[1], &g[2])],
        jacobian: J,
    }
}

/// The tangent in the frames, times the volume.
struct Frame<'a, T> {
    U: &'a Mat3<T>,
    A: &'a [T; 6],
    shear: &'a Vec3<T>,
    coupling: &'a Vec3<T>,
}

impl<T: Real> Frame<'_, T> {
    /// Columns of the block of two shape vectors `x` and `y` in the rest frame, each turned by `U`.
    #[inline(always)]
    fn turned(&self, x: &Vec3<T>, y: &Vec3<T>) -> Mat3<T> {
        let mut turned = *self.U;
        for c in 0..3 {
            let mut column = *x;
            for r in 0..3 {
                column[r] = if r == c {
                    let (p, q) = ((r + 1) % 3, (r + 2) % 3);
                    self.A[TRIANGLE[r][r]] * x[r] * y[r] + self.shear[q] * x[p] * y[p] + self.shear[p] * x[q] * y[q]
                } else {
                    self.A[TRIANGLE[r][c]] * x[r] * y[c] + self.coupling[3 - r - c] * x[c] * y[r]
                };
            }
            turned[c] = matrix_product(self.U, &column);
        }
        turned
    }

    /// Entry `(r, c)` of `turned Uᵀ`.
    #[inline(always)]
    fn entry(&self, turned: &Mat3<T>, r: usize, c: usize) -> T {
        turned[0][r] * self.U[0][c] + turned[1][r] * self.U[1][c] + turned[2][r] * self.U[2][c]
    }

    /// Triangle of the block `K_ii`.
    #[inline(always)]
    fn triangle(&self, x: &Vec3<T>) -> [T; 6] {
        let t = self.turned(x, x);
        [
            self.entry(&t, 0, 0),
            self.entry(&t, 1, 0),
            self.entry(&t, 2, 0),
            self.entry(&t, 1, 1),
            self.entry(&t, 2, 1),
            self.entry(&t, 2, 2),
        ]
    }

    /// Block `K_ij`.
    #[inline(always)]
    fn block(&self, x: &Vec3<T>, y: &Vec3<T>) -> Mat3<T> {
        let t = self.turned(x, y);
        let mut block = t;
        for c in 0..3 {
            for r in 0..3 {
                block[c][r] = self.entry(&t, r, c);
            }
        }
        block
    }
}
