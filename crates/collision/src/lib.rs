//! Contacts between a tool and a deforming surface. Knows shapes and triangles, not physics.

pub mod broad_phase;
pub mod contact;
pub mod convert;
pub mod detection;
mod features;
pub mod hull;
pub mod narrow_phase;
pub mod patch;
pub mod shape;
pub mod tree;
pub mod triangle;

pub use broad_phase::{SurfaceError, SurfaceGeometry};
pub use contact::{Contact, ContactSet};
pub use detection::{ContactKind, DetectionConfig, DetectionReport, DetectionWorkspace, detect};
pub use patch::{PatchConfig, PatchDetection, PatchGathering, PatchReport, SkinPatch};
pub use shape::{ShapeError, ToolShape};
