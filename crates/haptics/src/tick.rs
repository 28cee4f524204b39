//! One tick of the haptic loop.
