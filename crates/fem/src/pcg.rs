//! Preconditioned conjugate gradients.
