//! Linear tetrahedra.
