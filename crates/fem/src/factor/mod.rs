//! Supernodal Cholesky factorisation of the system matrix, its solves and half solves.
//!
//! `P A Pᵀ = L Lᵀ` with `P` from [`crate::ordering`]. Three kinds of data: [`SymbolicFactor`] is made once per
//! topology and shared; [`Factor`] holds the numbers of one refactorisation; workspaces belong to the thread that
//! solves. After set-up nothing here allocates, and numerical trouble is a status in a report.
//!
//! * refactorisation: [`Factor::refactor`]
//! * full solves `x = A⁻¹ b`: [`Factor::solve`], [`Factor::solve_columns`]
//! * half solves over the reach of sparse rows, `Y = L⁻¹ P Hᵀ`, for `H A⁻¹ Hᵀ = Yᵀ Y` and `A⁻¹ Hᵀ λ`: [`reach`]
//! * a cut, or a node held or released: [`Factor::change`], until the next refactorisation
//!
//! LLᵀ rather than LDLᵀ: `W` wants the symmetric half `L⁻¹`, and a matrix that is not positive definite must be
//! reported, not factored.

mod arena;
mod change;
mod column_kernels;
mod correct;
mod front;
mod gram;
mod half_block;
mod half_front;
mod left_looking;
mod low_rank;
mod multifrontal;
mod nodal_compliance;
mod number;
mod numeric;
mod packed;
mod packed_copy;
mod packed_fronts;
mod packed_kernels;
mod permuted_blocks;
mod prepared_nodes;
pub mod reach;
mod solve;
mod substitution;
mod supernodal_tree;
mod symbolic;
mod walk;
mod workers;

pub use change::{ChangeStatus, MatrixChange};
pub use left_looking::LeftLookingFactor;
pub use low_rank::UpdateStatus;
pub use nodal_compliance::NodalCompliance;
pub use numeric::{Factor, FactorPrecision, FactorReport, FactorStatus};
pub use reach::{ReachReport, ReachStatus, ReachWorkspace};
pub use solve::{SolveStatus, SolveWorkspace};
pub use symbolic::{FactorError, SymbolicFactor};
