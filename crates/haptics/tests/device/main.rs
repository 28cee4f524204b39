//! The virtual device, the coupling to it, and the limits of its force.

#[path = "../rig/mod.rs"]
mod rig;

mod closed_loop;
mod limits;
mod passivity;
mod passivity_layer;
mod script;
mod stability_edge;
mod virtual_device;
mod wall;
