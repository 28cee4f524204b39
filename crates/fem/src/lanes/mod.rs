//! Several elements per pass: a number or a vector of numbers under one trait, and small matrices of them.
//!
//! A law or a kernel is written once over [`Real`] and runs on `f64`, one element at a time, or on [`Lanes`], as many
//! elements as the processor's vectors hold. The instruction set is found at run time ([`pulp::Arch`]). Lanes never
//! meet, and a product is never fused with a sum, so an element gets the same bits on every width of vector.

pub mod elementary;
mod real;
mod svd;
mod vector;

pub use self::{
    real::{Lanes, Real},
    svd::{Frames, eigenvectors, signed_svd},
    vector::{Mat3, Vec3, cross, dot, matrix_product, norm_squared, scaled, sum, transposed_product},
};
