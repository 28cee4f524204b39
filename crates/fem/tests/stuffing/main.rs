//! Tetrahedra from surfaces and label images.

mod bodies;
mod guarantee;
mod images;
mod liver;
mod readers;
mod surfaces;
