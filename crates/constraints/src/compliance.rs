//! Compliance in constraint space.
