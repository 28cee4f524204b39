//! The compliance of the contacts: its methods, its error, and the factor behind it.

#[path = "../block/mod.rs"]
mod block;

mod error;
mod ladder;
mod methods;
mod other_shape;
mod stale_factor;
mod unconverged;
