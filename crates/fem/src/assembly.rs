//! Parallel assembly of internal forces and the system matrix into a pattern built once.
