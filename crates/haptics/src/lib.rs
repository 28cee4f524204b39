//! The 1 kHz side: devices, the virtual hand, coupling, limits, the local contact problem and the tick.
//!
//! SI units, right-handed frames, world axes. A wrench is *on the hand*. Set-up returns [`SetupError`]; once running
//! nothing returns an error or panics: each tick fills a [`record::TickRecord`], and whatever is wrong ends in less
//! force, never in more.

#![cfg_attr(rtsan, feature(sanitize))]

pub mod body_contact;
pub mod coupling;
mod damper;
pub mod device;
pub mod error;
pub mod exchange;
pub mod gripper;
pub mod hand;
pub mod limits;
pub mod passivity;
pub mod patch;
pub mod record;
pub mod rig;
pub mod run;
pub mod script;
pub mod snapshot;
pub mod tick;
pub mod wrench;

pub use error::SetupError;
