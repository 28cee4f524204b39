//! The C library: `include/palpate.h` is made from this crate, and says what a C program needs to know.
//!
//! Nothing unwinds into C: every function catches panics and answers a status. Structs begin with their size, so that a
//! program compiled against an older or newer header works with this library: only bytes that both sides know are read
//! or written.

// The border to C is made of pointers from C.
#![allow(unsafe_code)]
#![cfg_attr(rtsan, feature(sanitize))]

mod input;
mod layout;
mod options;
mod output;
mod port;
mod simulation;
mod statistics;
mod status;
mod surface;

pub use input::*;
pub use options::{Options, PALPATE_OPTION_NO_DELAY, PALPATE_OPTION_OBSERVE_ENERGY_ONLY};
pub use output::*;
pub use port::*;
pub use simulation::*;
pub use statistics::*;
pub use status::{Status, palpate_last_error, palpate_status_text, palpate_version};
pub use surface::*;
