//! Nodes held and released, elements removed, while a scene runs.

#[path = "../block/mod.rs"]
mod block;

mod bad_input;
mod changes;
mod cut_elsewhere;
mod rest;
