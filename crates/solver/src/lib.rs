//! Solvers of the frictional contact problem `delta = W lambda + delta_free`.

pub mod gauss_seidel;
pub mod problem;
pub mod residual;
