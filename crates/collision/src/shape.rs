//! Tool shapes.
