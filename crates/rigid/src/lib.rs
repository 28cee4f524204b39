//! Rigid bodies: what they are (mass and inertia), where they are, and how they move when nothing touches them.

mod free_motion;
mod model;
mod moments;
mod state;

pub use free_motion::{FreeMotion, advance, free_motion};
pub use model::{RigidError, RigidModel};
pub use moments::Moments;
pub use state::RigidState;
