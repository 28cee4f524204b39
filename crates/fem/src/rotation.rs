//! Rotations of deformed elements and nodes: signed singular values, polar decomposition, nodal rotations.
//!
//! `F = U diag(sigma) Vᵀ` with `U` and `V` proper rotations: where `det F < 0` the smallest singular value is negative
//! [Irving, Teran, Fedkiw 2004], so that `R = U Vᵀ` is the proper rotation nearest to `F` also in an inverted element.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::{
    element::{
        QuadraticTetrahedron,
        quadratic::{EDGES, POINTS},
    },
    model::FemModel,
    sparse::FIXED,
};

/// `F = U diag(sigma) Vᵀ` with rotations `U`, `V` and `sigma[0] >= sigma[1] >= |sigma[2]|`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SignedSvd {
    /// Rotation of the deformed frame.
    pub U: Matrix3<f64>,
    /// Signed singular values, in the unit of `F`; only the last may be negative.
    pub sigma: Vector3<f64>,
    /// Rotation of the rest frame.
    pub V: Matrix3<f64>,
}

/// More sweeps than Jacobi's method needs for 3 x 3 (4 to 6): a bound for data that are not finite.
const SWEEPS: usize = 12;

/// Columns count as orthogonal at this cosine: a few units of rounding.
const ORTHOGONAL: f64 = 4.0 * f64::EPSILON;

/// Share of the largest singular value below which others count as zero: squares of smaller ones vanish.
const NEGLIGIBLE: f64 = 1e-150;

/// Signed singular value decomposition of any 3 x 3 matrix, by Jacobi rotations: of `FᵀF`, which is cheap, and then of
/// the columns of `F V`, which corrects what squaring lost.
///
/// Never fails: a zero matrix gives `U = V = I`; a flat or linear one is completed to proper rotations. Entries that
/// are not finite give `U = V = I` and `sigma = NaN`. The last stage keeps small singular values accurate.
pub fn signed_svd(F: &Matrix3<f64>) -> SignedSvd {
    let scale = F.amax();
    if !F.iter().all(|x| x.is_finite()) {
        return SignedSvd { U: Matrix3::identity(), sigma: Vector3::repeat(f64::NAN), V: Matrix3::identity() };
    }
    // Below the smallest normal number F counts as zero.
    if scale < f64::MIN_POSITIVE {
        return SignedSvd { U: Matrix3::identity(), sigma: Vector3::zeros(), V: Matrix3::identity() };
    }
    // Squares of squares of the entries must neither overflow nor vanish.
    let unit = if (1e-60..1e60).contains(&scale) { 1.0 } else { scale };
    let F = F / unit;
    let mut v = eigenvectors(&(F.transpose() * F));
    let mut b = v.map(|v| F * v);
    for _ in 0..SWEEPS {
        let rotated = rotate(&mut b, &mut v, 0, 1) | rotate(&mut b, &mut v, 0, 2) | rotate(&mut b, &mut v, 1, 2);
        if !rotated {
            break;
        }
    }
    // Descending order; each exchange turns one column over, so that V stays a rotation.
    for (i, j) in [(0, 1), (1, 2), (0, 1)] {
        if b[i].norm_squared() < b[j].norm_squared() {
            b.swap(i, j);
            v.swap(i, j);
            b[i] = -b[i];
            v[i] = -v[i];
        }
    }
    let sigma0 = b[0].norm();
    let u0 = b[0] / sigma0;
    // Gram-Schmidt: the second column may be rounding noise where F has rank one.
    let b1 = b[1] - u0 * u0.dot(&b[1]);
    let norm1 = b1.norm();
    let plane = norm1 > NEGLIGIBLE * sigma0;
    let u1 = if plane { b1 / norm1 } else { perpendicular(&u0) };
    let u2 = u0.cross(&u1);
    let sigma = if plane { Vector3::new(sigma0, norm1, b[2].dot(&u2)) } else { Vector3::new(sigma0, 0.0, 0.0) } * unit;
    SignedSvd { U: Matrix3::from_columns(&[u0, u1, u2]), sigma, V: Matrix3::from_columns(&v) }
}

/// Eigenvectors of a symmetric matrix by cyclic Jacobi rotations, to the absolute accuracy of its largest entry.
#[inline]
fn eigenvectors(C: &Matrix3<f64>) -> [Vector3<f64>; 3] {
    let mut d = [C[(0, 0)], C[(1, 1)], C[(2, 2)]];
    // Off-diagonal entries, numbered by the index that they lack.
    let mut o = [C[(1, 2)], C[(0, 2)], C[(0, 1)]];
    let mut v = [Vector3::x(), Vector3::y(), Vector3::z()];
    let negligible = (f64::EPSILON * (d[0] + d[1] + d[2])).powi(2);
    for _ in 0..SWEEPS {
        if o[0] * o[0] + o[1] * o[1] + o[2] * o[2] <= negligible {
            break;
        }
        turn(&mut d, &mut o, &mut v, 0, 1, 2);
        turn(&mut d, &mut o, &mut v, 0, 2, 1);
        turn(&mut d, &mut o, &mut v, 1, 2, 0);
    }
    v
}

/// One Jacobi rotation of directions `p` and `q`; `r` is the third. Inlined, so that all indices are constants.
#[inline(always)]
fn turn(d: &mut [f64; 3], o: &mut [f64; 3], v: &mut [Vector3<f64>; 3], p: usize, q: usize, r: usize) {
    let (t, c) = jacobi_rotation(d[q] - d[p], o[r]);
    let s = c * t;
    d[p] -= t * o[r];
    d[q] += t * o[r];
    o[r] = 0.0;
    // o[q] couples r with p, o[p] couples r with q.
    (o[q], o[p]) = (o[q] * c - o[p] * s, o[q] * s + o[p] * c);
    (v[p], v[q]) = (v[p] * c - v[q] * s, v[p] * s + v[q] * c);
}

/// Tangent (of the smaller angle) and cosine of the rotation that cancels the coupling `gamma` of two directions whose
/// diagonal entries differ by `difference`; neither cancels nor divides by zero.
#[inline]
fn jacobi_rotation(difference: f64, gamma: f64) -> (f64, f64) {
    let root = (difference * difference + 4.0 * gamma * gamma).sqrt();
    let t = 2.0 * gamma * difference.signum() / (difference.abs() + root).max(f64::MIN_POSITIVE);
    (t, (1.0 + t * t).sqrt().recip())
}

/// Makes columns `p` and `q` orthogonal. Returns whether they were not.
#[inline]
fn rotate(b: &mut [Vector3<f64>; 3], v: &mut [Vector3<f64>; 3], p: usize, q: usize) -> bool {
    let (alpha, beta, gamma) = (b[p].norm_squared(), b[q].norm_squared(), b[p].dot(&b[q]));
    if gamma * gamma <= ORTHOGONAL * ORTHOGONAL * alpha * beta || gamma.abs() < f64::MIN_POSITIVE {
        return false;
    }
    let (t, c) = jacobi_rotation(beta - alpha, gamma);
    let s = c * t;
    (b[p], b[q]) = (b[p] * c - b[q] * s, b[p] * s + b[q] * c);
    (v[p], v[q]) = (v[p] * c - v[q] * s, v[p] * s + v[q] * c);
    true
}

/// A unit vector perpendicular to the unit vector `u`.
fn perpendicular(u: &Vector3<f64>) -> Vector3<f64> {
    let axis = match u.abs().imin() {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    let w = axis - u * u.dot(&axis);
    w / w.norm()
}

/// `F = R S`: the proper rotation `R` nearest to `F` in the Frobenius norm.
///
/// Newton's iteration `R <- (R + R⁻ᵀ) / 2` [Higham 1986] where `F` is far from singular and not inverted, otherwise
/// from [`signed_svd`]; agreement of both to rounding. The identity where `F` is zero or not finite.
pub fn polar_rotation(F: &Matrix3<f64>) -> Matrix3<f64> {
    let size = F.norm_squared();
    let det = F.determinant();
    // Below this ratio (1 for F with equal singular values) Newton's iteration loses digits, and SVD takes over.
    let regular = det > 0.02 * (size / 3.0) * (size / 3.0).sqrt();
    if !regular {
        let svd = signed_svd(F);
        return svd.U * svd.V.transpose();
    }
    let mut R = F * det.cbrt().recip();
    for _ in 0..20 {
        let c = cofactor(&R);
        // The determinant by the cofactors that are there, and one division in place of nine.
        let next = (R + c * R.column(0).dot(&c.column(0)).recip()) * 0.5;
        let moved = (next - R).norm_squared();
        R = next;
        // Convergence is quadratic: a change of 1e-8 leaves an error of 1e-16.
        if moved < 1e-17 {
            break;
        }
    }
    R
}

/// Cofactor matrix `∂ det F / ∂F`: columns `f1 x f2, f2 x f0, f0 x f1`. Equals `det F F⁻ᵀ`, and exists for any `F`.
#[inline]
pub fn cofactor(F: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b, c): (Vector3<f64>, Vector3<f64>, Vector3<f64>) =
        (F.column(0).into_owned(), F.column(1).into_owned(), F.column(2).into_owned());
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// Nodes whose rotations one task finds.
const NODES: usize = 512;

/// Rotation of every free node from configuration `q_from` to `q_to`.
///
/// The rotation nearest to the mean, over the elements at a node or the points of quadratic ones, of the relative
/// deformation `F_to F_from⁻¹` scaled to unit norm and weighted by rest volume. Saupin, Duriez, Cotin and Grisoni (2008) take
/// the mean of the elements' rotations, which costs a polar decomposition for each; there are four to five elements to a
/// node, and a factor that is warped by either takes as many iterations. An element that is flat in `q_from`, or not
/// finite, adds the identity. Lengths: `q_from`, `q_to` one position per node (m); `rotations` one matrix per free node.
/// Allocates nothing; elements are added in mesh order on one thread, the nodes' rotations found on all of a pool.
pub fn nodal_rotations(
    model: &FemModel,
    q_from: &[Vector3<f64>],
    q_to: &[Vector3<f64>],
    rotations: &mut [Matrix3<f64>],
) {
    rotations.fill(Matrix3::zeros());
    for element in model.quadratic_elements() {
        add_quadratic(model, element, q_from, q_to, rotations);
    }
    let linear = if model.quadratic_elements().is_empty() { model.elements() } else { &[] };
    for (element, nodes) in linear.iter().zip(model.free_tetrahedra()) {
        let from = element.edges(q_from);
        let to = element.edges(q_to);
        let weighted = relative_deformation(&from, &to) * element.volume;
        for &k in nodes.iter().filter(|&&k| k != FIXED) {
            rotations[k as usize] += weighted;
        }
    }
    let nearest = |rotations: &mut [Matrix3<f64>]| rotations.iter_mut().for_each(|r| *r = polar_rotation(r));
    if rayon::current_num_threads() > 1 {
        rotations.par_chunks_mut(NODES).for_each(nearest);
    } else {
        nearest(rotations);
    }
}

/// Adds the deformations at the points of a quadratic element, each to the corner near to it and to that corner's mid-nodes.
fn add_quadratic(
    model: &FemModel,
    element: &QuadraticTetrahedron,
    q_from: &[Vector3<f64>],
    q_to: &[Vector3<f64>],
    rotations: &mut [Matrix3<f64>],
) {
    let (from, to) = (element.deformation_gradients(q_from), element.deformation_gradients(q_to));
    let free = element.nodes.map(|i| model.free_of_node()[i as usize]);
    for k in 0..POINTS {
        let weighted = relative_deformation(&from[k], &to[k]) * element.weights[k];
        let mids = EDGES.iter().zip(&free[4..]).filter(|((a, b), _)| *a == k || *b == k).map(|(_, &free)| free);
        for free in mids.chain([free[k]]).filter(|&free| free != FIXED) {
            rotations[free as usize] += weighted;
        }
    }
}

/// `to from⁻¹`, scaled to the norm of a rotation; the identity where `from` is flat to rounding or an entry is not finite.
fn relative_deformation(from: &Matrix3<f64>, to: &Matrix3<f64>) -> Matrix3<f64> {
    let det = from.determinant();
    // `from⁻¹ = cofᵀ / det`; the sign of det is kept and its size drops out with the scale.
    let relative = to * cofactor(from).transpose() * det.signum();
    let size = relative.norm();
    let regular = det.abs() > 1e-12 * from.norm().powi(3) && size.is_finite() && size > 0.0;
    if regular { relative * (3.0_f64.sqrt() / size) } else { Matrix3::identity() }
}
