//! Quadratic elements with straight edges as four linear ones over the same shape, one for each point of quadrature.
//!
//! The gradients `D_a` of the barycentric coordinates `l_a` are uniform there. Name the ten nodes by the symmetric array
//! `x_ac`: corner `a` is `x_aa`, the mid-node between `a` and `c` is `x_ac`. Then at a point `k`
//! ```text
//! F = Σ_a u_a ⊗ D_a,   u_a = ∂x/∂l_a = 4 Σ_c l_c x_ac - x_aa = g Σ_c x_ac - x_aa + m x_ak      m
//! ```
//! since at a point of quadrature all `l_c` are `g / 4` but the nearest corner's, which is `(g + m) / 4`. So `F` is that of
//! a linear element with the edges `u_a - u_0`; and what that element has for its four nodes `a` goes to the ten by the
//! transposed map, forces once ([`to_nodes`]) and stiffness from both sides ([`to_columns`], [`to_nodes`]): sums with two
//! constants, the same for every element.

use crate::lanes::Real;

/// Four times the barycentric coordinate of a point of quadrature at a far corner, `1 - 1/√5`.
const G: f64 = 0.552_786_404_500_042_1;

/// What the nearest corner has more, `4/√5`.
const M: f64 = 1.788_854_381_999_831_8;

/// One component of the edges at the four points, `u_a - u_0` for `a` of 1 to 3, from that of the ten nodes.
#[inline(always)]
pub(super) fn edges_at_points<T: Real>(x: &[T; 10]) -> [[T; 3]; 4] {
    let [c0, c1, c2, c3, m01, m12, m02, m03, m13, m23] = *x;
    // x_ac.
    let x = [[c0, m01, m02, m03], [m01, c1, m12, m13], [m02, m12, c2, m23], [m03, m13, m23, c3]];
    let mut base = [c0; 4];
    for a in 0..4 {
        base[a] = (x[a][0] + x[a][1] + x[a][2] + x[a][3]) * G - x[a][a];
    }
    let mut edges = [[c0; 3]; 4];
    for k in 0..4 {
        for a in 1..4 {
            edges[k][a - 1] = (base[a] - base[0]) + (x[a][k] - x[0][k]) * M;
        }
    }
    edges
}

/// What four nodes have at the four points, `at[k][a]`, summed for the ten nodes.
#[inline(always)]
pub(super) fn to_nodes<T: Real>(at: &[[T; 4]; 4]) -> [T; 10] {
    let mut sum = at[0];
    let mut share = at[0];
    for a in 0..4 {
        sum[a] = at[0][a] + at[1][a] + at[2][a] + at[3][a];
        share[a] = sum[a] * G;
    }
    let corner = |a: usize| (share[a] - sum[a]) + at[a][a] * M;
    let mid = |a: usize, c: usize| share[a] + share[c] + (at[c][a] + at[a][c]) * M;
    [corner(0), corner(1), corner(2), corner(3), mid(0, 1), mid(1, 2), mid(0, 2), mid(0, 3), mid(1, 3), mid(2, 3)]
}

/// One row of the stiffness at point `k`, from the four nodes to the ten.
#[inline(always)]
pub(super) fn to_columns<T: Real>(row: &[T; 4], k: usize) -> [T; 10] {
    let (mut share, mut near) = (*row, *row);
    for b in 0..4 {
        share[b] = row[b] * G;
        near[b] = row[b] * M;
    }
    let corner = |b: usize| if b == k { (share[b] - row[b]) + near[b] } else { share[b] - row[b] };
    let mid = |b: usize, d: usize| {
        let both = share[b] + share[d];
        if d == k {
            both + near[b]
        } else if b == k {
            both + near[d]
        } else {
            both
        }
    };
    [corner(0), corner(1), corner(2), corner(3), mid(0, 1), mid(1, 2), mid(0, 2), mid(0, 3), mid(1, 3), mid(2, 3)]
}
