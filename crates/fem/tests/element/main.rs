//! The elements beside one another, and their order of convergence.

#[path = "../element_study/mod.rs"]
mod element_study;
#[path = "../tissue_setup/mod.rs"]
mod tissue_setup;

mod convergence;
mod kinds;
