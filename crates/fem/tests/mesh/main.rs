//! Meshes: their surface, what is refused, and nodes on edges.

#[path = "../format_samples/mod.rs"]
mod format_samples;
#[path = "../tissue_setup/mod.rs"]
mod tissue_setup;

mod promotion;
mod surface;
mod validation;
