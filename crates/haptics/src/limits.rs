//! Force, slew and fade limits.
