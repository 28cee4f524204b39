//! The commands of the program, as a shell runs them.

#[path = "../program_runs/mod.rs"]
mod program_runs;

mod bad_input;
mod chart;
mod contact_laws;
mod equilibrium;
mod mesh;
mod plan;
mod scene_fuzz;
mod solve;
mod solve_bad_input;
mod summary;
mod units;
