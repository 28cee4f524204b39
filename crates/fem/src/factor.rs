//! Supernodal Cholesky factorisation of the system matrix, its solves and half solves.
