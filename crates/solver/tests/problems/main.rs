//! Problems in closed form, at random, in files, and beyond the limits.

#[path = "../half_space/mod.rs"]
mod half_space;

mod agreement;
mod automatic_order;
mod contacts_in_closed_form;
mod lagrange;
mod limits;
mod problem_files;
mod proximal_points;
mod random_problems;
mod rigid_bodies;
mod robustness;
mod siconos_files;
