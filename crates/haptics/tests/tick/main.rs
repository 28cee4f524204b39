//! The tick on the local patch: contacts, steps, faults and wild numbers.

#[path = "../rig/mod.rs"]
mod rig;
#[path = "../sheet/mod.rs"]
mod sheet;

mod bodies;
mod creep;
mod fast_steps;
mod faults;
mod grasp;
mod one;
mod patch;
mod renumbering;
mod reset;
mod snapshot_fields;
mod two_clocks;
mod wild_numbers;
mod wild_snapshots;
