//! Contacts between a tool and a deforming surface. Knows shapes and triangles, not physics.

pub mod broad_phase;
pub mod contact;
pub mod convert;
pub mod detection;
pub mod narrow_phase;
pub mod shape;
