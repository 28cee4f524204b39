//! Isosurface stuffing: label images and closed surfaces to tetrahedra of guaranteed quality.
