//! Contacts of tools and solids with a deforming surface, and of solids with one another. Knows shapes and triangles, not physics.

pub mod broad_phase;
pub mod contact;
pub mod convert;
pub mod detection;
mod features;
pub mod held;
pub mod hull;
pub mod narrow_phase;
pub mod patch;
pub mod shape;
pub mod solid;
pub mod solid_contact;
pub mod solid_detection;
pub mod solid_mesh;
pub mod tool;
pub mod tree;
pub mod triangle;
pub mod turn;

pub use broad_phase::{SurfaceError, SurfaceGeometry};
pub use contact::{Contact, ContactSet};
pub use detection::{ContactKind, DetectionConfig, DetectionReport, DetectionWorkspace, detect, detect_tool};
pub use patch::{PatchConfig, PatchDetection, PatchGathering, PatchReport, SkinPatch};
pub use shape::{ShapeError, ToolShape};
pub use solid::{Solid, SolidError};
pub use solid_contact::{SolidContact, meet};
pub use solid_detection::detect_solid;
pub use tool::{Tool, ToolError, ToolPose};
pub use turn::Turn;
