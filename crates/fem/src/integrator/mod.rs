//! Integration in time, and equilibrium.
//!
//! | method | file | order | per step | use |
//! | --- | --- | --- | --- | --- |
//! | backward Euler, one linearisation | of the caller, by [`assemble`](crate::assembly::assemble) | 1 | one assembly, one solve | real time |
//! | backward Euler, Newton with line search | [`backward_euler`] | 1 | some of both | reference |
//! | central differences, lumped mass | [`explicit`] | 2 | one or two evaluations of forces | waves, soft tissue near 1 kHz |
//! | static equilibrium, load stepping | [`equilibrium`] | - | - | the state in which a run begins, reference |
//!
//! Both forms of backward Euler and the equilibrium lower one potential ([`potential`]) by one Newton method
//! ([`newton`]). Description, state and workspace are three types: [`crate::model::FemModel`],
//! [`crate::model::FemState`], and one workspace per family, sized at set-up; no step allocates.

pub mod backward_euler;
pub mod critical_step;
pub mod equilibrium;
pub mod explicit;
pub mod newton;
pub mod potential;

use nalgebra::Vector3;

/// Scalar product in the order of the unknowns: the same bits for any number of threads.
fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// Euclidean norm.
fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// Node `k` of a vector over the free nodes.
fn nodal(x: &[f64], k: usize) -> Vector3<f64> {
    match x.get(3 * k..3 * k + 3) {
        Some(x) => Vector3::new(x[0], x[1], x[2]),
        None => Vector3::zeros(),
    }
}
