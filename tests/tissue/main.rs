//! Tissue in whole runs: vibration, integrators, laws, rest, and the same bits every time.

#[path = "../block/mod.rs"]
mod block;
#[path = "../../crates/fem/tests/integrator_setup/mod.rs"]
mod integrator_setup;
#[path = "../ordeals/mod.rs"]
mod ordeals;

mod bad_input;
mod determinism;
mod free_vibration;
mod integrators;
mod laws;
mod robustness;
mod settle;
