//! The natural-map residual, one for all solvers.
