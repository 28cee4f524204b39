//! Rows of contacts, their compliance, and warm starts.

#[path = "../common/mod.rs"]
mod common;

mod bodies;
mod compliance;
mod lumped;
mod rows;
mod warm_start;
