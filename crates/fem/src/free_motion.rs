//! Backward Euler with one linearisation: the motion of a body that nothing touches.
