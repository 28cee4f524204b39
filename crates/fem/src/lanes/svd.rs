//! Signed singular values over [`Real`]: the algorithm of [`crate::rotation::signed_svd`] without branches per element.
//!
//! A sweep goes on while any lane needs it; a lane that is done is turned by the angle zero, so that what an element
//! gets does not depend on its neighbours.

#![allow(non_snake_case)]

use super::{Mat3, Real, Vec3, cross, dot, matrix_product, norm_squared, scaled};

/// `F = U diag(sigma) Vᵀ` with rotations `U`, `V` and `sigma[0] >= sigma[1] >= |sigma[2]|`; only the last may be negative.
#[derive(Clone, Copy, Debug)]
pub struct Frames<T> {
    /// Rotation of the deformed frame.
    pub U: Mat3<T>,
    /// Signed singular values.
    pub sigma: Vec3<T>,
    /// Rotation of the rest frame.
    pub V: Mat3<T>,
}

/// More sweeps than Jacobi's method needs for 3 x 3 (4 to 6): a bound for data that are not finite.
const SWEEPS: usize = 12;

/// Columns count as orthogonal at this cosine. What is left couples the two directions by this share of the larger
/// singular value: rounding.
const ORTHOGONAL: f64 = 16.0 * f64::EPSILON;

/// Share of the largest singular value below which others count as zero: squares of smaller ones vanish.
const NEGLIGIBLE: f64 = 1e-150;

/// Signed singular value decomposition. Never fails: a matrix without rank is completed to proper rotations; entries
/// that are not finite give NaN in `U` and `sigma`.
#[inline(always)]
pub fn signed_svd<T: Real>(F: &Mat3<T>) -> Frames<T> {
    let one = F[0][0].constant(1.0);
    let mut scale = F[0][0].abs();
    for x in F.as_flattened() {
        scale = x.abs().larger(scale);
    }
    // Squares of squares of the entries must neither overflow nor vanish.
    let small = one.constant(1e-60).above(scale);
    let large = scale.above(one.constant(1e60));
    let present = scale.above(one.constant(f64::MIN_POSITIVE));
    let unit = scale.or_where_not(large, scale.or_where_not(small, one)).or_where_not(present, one);
    let per_unit = unit.recip();
    let F = [scaled(&F[0], per_unit), scaled(&F[1], per_unit), scaled(&F[2], per_unit)];
    let (_, mut v) = eigenvectors(
        [norm_squared(&F[0]), norm_squared(&F[1]), norm_squared(&F[2])],
        [dot(&F[1], &F[2]), dot(&F[0], &F[2]), dot(&F[0], &F[1])],
    );
    let mut b = [matrix_product(&F, &v[0]), matrix_product(&F, &v[1]), matrix_product(&F, &v[2])];
    for _ in 0..SWEEPS {
        let rotated = rotate(&mut b, &mut v, 0, 1) | rotate(&mut b, &mut v, 0, 2) | rotate(&mut b, &mut v, 1, 2);
        if !rotated {
            break;
        }
    }
    sort(&mut b, &mut v, 0, 1);
    sort(&mut b, &mut v, 1, 2);
    sort(&mut b, &mut v, 0, 1);

    let zero = one.constant(0.0);
    let sigma0 = norm_squared(&b[0]).sqrt();
    // False for NaN, which then passes through.
    let none = one.constant(f64::MIN_POSITIVE).above(sigma0);
    let u0 = select(none, &v[0], &scaled(&b[0], sigma0.recip()));
    // Gram-Schmidt: the second column may be rounding noise where F has rank one.
    let along = dot(&u0, &b[1]);
    let b1 = [b[1][0] - u0[0] * along, b[1][1] - u0[1] * along, b[1][2] - u0[2] * along];
    let norm1 = norm_squared(&b1).sqrt();
    let line = (sigma0 * NEGLIGIBLE).larger(one.constant(f64::MIN_POSITIVE)).above(norm1);
    let u1 = select(line, &perpendicular(&u0), &scaled(&b1, norm1.recip()));
    let u2 = cross(&u0, &u1);
    let sigma1 = zero.or_where_not(line, norm1);
    let sigma2 = zero.or_where_not(line, dot(&b[2], &u2));
    Frames { U: [u0, u1, u2], sigma: [sigma0 * unit, sigma1 * unit, sigma2 * unit], V: v }
}

/// Eigenvalues and eigenvectors (columns of a rotation) of the symmetric matrix with diagonal `d` and off-diagonal
/// entries `o`, numbered by the index that they lack; to the absolute accuracy of the largest entry, in no order.
#[inline(always)]
pub fn eigenvectors<T: Real>(mut d: Vec3<T>, mut o: Vec3<T>) -> (Vec3<T>, Mat3<T>) {
    let (zero, one) = (d[0].constant(0.0), d[0].constant(1.0));
    let mut v = [[one, zero, zero], [zero, one, zero], [zero, zero, one]];
    let size = (d[0].abs() + d[1].abs() + d[2].abs()) * f64::EPSILON;
    let negligible = size * size;
    for _ in 0..SWEEPS {
        let active = norm_squared(&o).above(negligible);
        if !zero.any(active) {
            break;
        }
        for o in &mut o {
            *o = o.or_where_not(active, zero);
        }
        turn(&mut d, &mut o, &mut v, 0, 1, 2);
        turn(&mut d, &mut o, &mut v, 0, 2, 1);
        turn(&mut d, &mut o, &mut v, 1, 2, 0);
    }
    (d, v)
}

/// One Jacobi rotation of directions `p` and `q`; `r` is the third.
#[inline(always)]
fn turn<T: Real>(d: &mut Vec3<T>, o: &mut Vec3<T>, v: &mut Mat3<T>, p: usize, q: usize, r: usize) {
    let (t, c) = jacobi_rotation(d[q] - d[p], o[r]);
    let s = c * t;
    let change = t * o[r];
    d[p] = d[p] - change;
    d[q] = d[q] + change;
    o[r] = o[r].constant(0.0);
    // o[q] couples r with p, o[p] couples r with q.
    (o[q], o[p]) = (o[q] * c - o[p] * s, o[q] * s + o[p] * c);
    turn_columns(v, p, q, c, s);
}

/// Tangent (of the smaller angle) and cosine of the rotation that cancels the coupling `gamma` of two directions whose
/// diagonal entries differ by `difference`; neither cancels nor divides by zero. The identity where `gamma` is zero.
#[inline(always)]
fn jacobi_rotation<T: Real>(difference: T, gamma: T) -> (T, T) {
    let twice = gamma + gamma;
    let root = (difference * difference + twice * twice).sqrt();
    let zero = gamma.constant(0.0);
    let signed = (-twice).or_where_not(zero.above(difference), twice);
    let t = signed / (difference.abs() + root).larger(gamma.constant(f64::MIN_POSITIVE));
    (t, (t * t + 1.0).sqrt().recip())
}

/// Makes columns `p` and `q` orthogonal. Returns whether they were not in some lane.
#[inline(always)]
fn rotate<T: Real>(b: &mut Mat3<T>, v: &mut Mat3<T>, p: usize, q: usize) -> bool {
    let (alpha, beta, gamma) = (norm_squared(&b[p]), norm_squared(&b[q]), dot(&b[p], &b[q]));
    let zero = gamma.constant(0.0);
    let bound = (alpha * beta * (ORTHOGONAL * ORTHOGONAL)).larger(gamma.constant(f64::MIN_POSITIVE));
    let active = (gamma * gamma).above(bound);
    if !zero.any(active) {
        return false;
    }
    let (t, c) = jacobi_rotation(beta - alpha, gamma.or_where_not(active, zero));
    let s = c * t;
    turn_columns(b, p, q, c, s);
    turn_columns(v, p, q, c, s);
    true
}

#[inline(always)]
fn turn_columns<T: Real>(v: &mut Mat3<T>, p: usize, q: usize, c: T, s: T) {
    for k in 0..3 {
        (v[p][k], v[q][k]) = (v[p][k] * c - v[q][k] * s, v[p][k] * s + v[q][k] * c);
    }
}

/// Exchanges columns `p` and `q` where the second is longer, and turns one over, so that `V` stays a rotation.
#[inline(always)]
fn sort<T: Real>(b: &mut Mat3<T>, v: &mut Mat3<T>, p: usize, q: usize) {
    let exchange = norm_squared(&b[q]).above(norm_squared(&b[p]));
    for m in [b, v] {
        for k in 0..3 {
            let (x, y) = (m[p][k], m[q][k]);
            m[p][k] = (-y).or_where_not(exchange, x);
            m[q][k] = x.or_where_not(exchange, y);
        }
    }
}

/// A unit vector perpendicular to the unit vector `u`.
#[inline(always)]
fn perpendicular<T: Real>(u: &Vec3<T>) -> Vec3<T> {
    let (zero, one) = (u[0].constant(0.0), u[0].constant(1.0));
    // The axis of the smallest component.
    let x = one.or_where_not(u[1].abs().above(u[0].abs()), zero);
    let x = x.or_where_not(u[2].abs().above(u[0].abs()), zero);
    let y = one.or_where_not(u[2].abs().above(u[1].abs()), zero) * (one - x);
    let axis = [x, y, one - x - y];
    let along = dot(&axis, u);
    let w = [axis[0] - u[0] * along, axis[1] - u[1] * along, axis[2] - u[2] * along];
    scaled(&w, norm_squared(&w).sqrt().recip())
}

#[inline(always)]
fn select<T: Real>(mask: T::Mask, yes: &Vec3<T>, no: &Vec3<T>) -> Vec3<T> {
    [yes[0].or_where_not(mask, no[0]), yes[1].or_where_not(mask, no[1]), yes[2].or_where_not(mask, no[2])]
}
