//! Block Gauss-Seidel.
