//! Solvers of the frictional contact problem `delta = W lambda + delta_free`.
//!
//! A [`ConstraintProblem`](problem::ConstraintProblem) is a value: compliance `W` in m/N, gaps `delta_free` in m, and
//! the law of each block of rows. A solver reads a [`ProblemView`](problem::ProblemView), starts from the forces it is
//! given, and answers with forces in N and a [`SolveReport`](report::SolveReport). All solvers stop on the residual of
//! [`residual`]. A solver is one file and one line in [`solver`].

pub mod accelerated_gradient;
mod active_block;
mod active_rows;
mod active_system;
mod anderson;
mod augmented;
pub mod automatic;
pub mod comparison;
mod complementarity;
mod conic;
pub mod conic_friction;
pub mod conic_qp;
mod coupled_block;
mod dense;
mod first_substitution;
pub mod gauss_seidel;
mod iteration;
mod krylov;
pub mod lagrange;
pub mod lemke;
pub mod newton;
pub mod nncg;
mod open_contacts;
pub mod problem;
pub mod problem_file;
mod proximal;
pub mod report;
pub mod residual;
mod rough_contact;
mod rough_sweeps;
mod single;
mod small_system;
pub mod solver;
pub mod stepped_sweeps;
mod tableau;
pub mod vectors;
pub mod watch;
