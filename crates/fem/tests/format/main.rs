//! The readers and writers of meshes.

#[path = "../format_samples/mod.rs"]
mod format_samples;

mod faults;
mod fuzz;
mod round_trip;
mod shared_files;
mod variants;
