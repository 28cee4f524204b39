//! Quadratic elements with curved edges: any gradients `g_i` of the nodes at the points of quadrature.
//!
//! There is no shape that the points share, so the four linear elements stand in the space of `F` itself: shape vectors
//! `D_a = e_a`, edges `F e_a`, and what they have for their nodes 1 to 3 goes to the ten by the components of the gradients:
//! `f_i = Σ_k Σ_a g_ia f_a`, `K_ij = Σ_k Σ_ab g_ia K_ab g_jb`, with those of node 0 minus the sums over the others.

use crate::lanes::{Real, Vec3};

/// Components of the gradients of nodes 1 to 9 (1/m).
pub(super) type Gradients<T> = [[T; 3]; 9];

/// One component of `F e_a` from that of the nine edges from node 0.
#[inline(always)]
pub(super) fn edges_at_point<T: Real>(x: &[T; 9], g: &Gradients<T>) -> Vec3<T> {
    let mut edges = [x[0] * g[0][0], x[0] * g[0][1], x[0] * g[0][2]];
    for i in 1..9 {
        for a in 0..3 {
            edges[a] = edges[a] + x[i] * g[i][a];
        }
    }
    edges
}

/// Adds what the nodes 1 to 3 have at a point to the nodes 1 to 9.
#[inline(always)]
pub(super) fn add_to_nodes<T: Real>(at: &Vec3<T>, g: &Gradients<T>, nodes: &mut [T; 9]) {
    for i in 0..9 {
        nodes[i] = nodes[i] + (g[i][0] * at[0] + g[i][1] * at[1] + g[i][2] * at[2]);
    }
}

/// One row of the stiffness at a point, from the nodes 1 to 3 to the nodes 1 to 9.
#[inline(always)]
pub(super) fn to_columns<T: Real>(row: &Vec3<T>, g: &Gradients<T>) -> [T; 9] {
    let mut columns = [row[0]; 9];
    for i in 0..9 {
        columns[i] = g[i][0] * row[0] + g[i][1] * row[1] + g[i][2] * row[2];
    }
    columns
}

/// Node 0, minus the sum over the others, and the others.
#[inline(always)]
pub(super) fn complete<T: Real>(nodes: &[T; 9]) -> [T; 10] {
    let mut all = [nodes[0]; 10];
    let mut sum = nodes[0];
    for i in 0..9 {
        all[i + 1] = nodes[i];
        if i > 0 {
            sum = sum + nodes[i];
        }
    }
    all[0] = -sum;
    all
}
