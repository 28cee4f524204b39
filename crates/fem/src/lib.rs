//! Finite elements for soft tissue: meshes, materials, assembly, sparse factorisation, preconditioned CG.
//!
//! Units are SI throughout. Sign conventions: `f_int` is the force that the tissue exerts on its nodes,
//! `K = -d f_int / d q`, `A = M + h C + h² K` (kg), and the unknown of a linear solve is a change of velocity.

pub mod assembly;
pub mod averaging;
pub mod block;
pub mod closed_surface;
mod directions;
pub mod element;
pub mod factor;
pub mod format;
pub mod image;
pub mod integrator;
pub mod lanes;
pub mod material;
pub mod mesh;
pub mod model;
pub mod nodal_rows;
pub mod ordering;
pub mod pack;
pub mod pcg;
pub mod preconditioner;
pub mod rotation;
pub mod sparse;
pub mod stuffing;
pub mod surface;
