//! Haptic hardware: vendors' libraries loaded at run time, local services, and recorded traces.
//!
//! Each driver is a file. A device speaks its own frame; [`place::Placed`] turns it into the world.

pub mod place;
