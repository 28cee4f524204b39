//! The steps in time, and equilibrium.

#[path = "../integrator_setup/mod.rs"]
mod integrator_setup;

mod backward_euler;
mod equilibrium;
mod explicit;
