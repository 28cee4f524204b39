//! Polar decomposition and nodal rotations.
