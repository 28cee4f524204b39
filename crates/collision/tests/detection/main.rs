//! Detection: gaps, patches, shapes, sides, solids and tools.

#[path = "../common/mod.rs"]
mod common;

mod gaps;
mod patch;
mod properties;
mod shapes;
mod sides;
mod solids;
mod tool;
