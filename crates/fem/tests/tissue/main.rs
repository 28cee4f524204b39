//! The laws of tissue, and its forces and tangents.

#[path = "../tissue_setup/mod.rs"]
mod tissue_setup;

mod assembly;
mod cantilever;
mod change;
mod continued_laws;
mod curves;
mod derivatives;
mod folds;
mod forces_alone;
mod mistakes;
mod packs;
mod parts;
mod patch;
mod quadratic_packs;
mod random;
mod reference;
mod rotation;
mod viscosity;
mod winding;
