//! Conversion between nalgebra and parry's types.
