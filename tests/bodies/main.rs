//! Fixed and rigid bodies.

mod fixed_bodies;
mod rigid_bodies;
mod sofa_scenes;
