//! The 1 kHz side: devices, the virtual hand, coupling, limits, the local contact problem and the tick.

pub mod coupling;
pub mod device;
pub mod exchange;
pub mod hand;
pub mod limits;
pub mod snapshot;
pub mod tick;
