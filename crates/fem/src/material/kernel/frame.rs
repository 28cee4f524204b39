//! From the derivatives of a law in the principal frame of `F` to forces and blocks: the definiteness filter and the way
//! back to the frame of the nodes (see [`principal`](crate::material::principal)).

#![allow(non_snake_case)]

use super::{Free, TRIANGLE, principal::PrincipalResponse};
use crate::{
    lanes::{Mat3, Real, Vec3, eigenvectors, matrix_product, scaled},
    material::principal::ROUNDING,
};

/// Replaces negative eigenvalues by zero. Returns 1 where one was negative beyond rounding, elsewhere 0.
///
/// NaN stays NaN; where an eigenvalue is infinite nothing counts as negative beyond rounding.
#[inline(always)]
pub(super) fn filter_response<T: Real>(response: &mut PrincipalResponse<T>) -> T {
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

/// `-V0 U Σ g_i` with the principal stresses `Σ`.
#[inline(always)]
pub(super) fn forces<T: Real>(stress: &Vec3<T>, U: &Mat3<T>, g: &Mat3<T>, V0: T) -> Mat3<T> {
    let stress = scaled(stress, -V0);
    let mut forces = *g;
    for i in 0..3 {
        forces[i] = matrix_product(U, &[stress[0] * g[i][0], stress[1] * g[i][1], stress[2] * g[i][2]]);
    }
    forces
}

/// Forces and blocks from the derivatives in the frames: `U`, and `g_i = Vᵀ D_i`.
#[inline(always)]
pub(super) fn assemble<T: Real>(response: &PrincipalResponse<T>, U: &Mat3<T>, g: &Mat3<T>, V0: T, J: T) -> Free<T> {
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
