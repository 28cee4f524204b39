//! Contact laws, constraint rows `H`, `delta_free` and the compliance `W = h² H A⁻¹ Hᵀ`.

pub mod body;
pub mod compliance;
mod compliance_report;
pub mod condensed;
pub mod frame;
pub mod law;
pub mod lumped;
pub mod penalty;
pub mod precomputed;
pub mod rows;
pub mod surface_inverse;
pub mod warm_start;
