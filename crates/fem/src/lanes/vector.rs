//! Vectors and matrices of three over [`Real`]. Matrices are arrays of columns, like nalgebra's.

#![allow(non_snake_case)]

use super::Real;

/// A vector of three.
pub type Vec3<T> = [T; 3];

/// A 3 x 3 matrix by columns.
pub type Mat3<T> = [[T; 3]; 3];

/// `a · b`.
#[inline(always)]
pub fn dot<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a · a`.
#[inline(always)]
pub fn norm_squared<T: Real>(a: &Vec3<T>) -> T {
    dot(a, a)
}

/// `a x b`.
#[inline(always)]
pub fn cross<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `s a`.
#[inline(always)]
pub fn scaled<T: Real>(a: &Vec3<T>, s: T) -> Vec3<T> {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// `a + b`.
#[inline(always)]
pub fn sum<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `A v`.
#[inline(always)]
pub fn matrix_product<T: Real>(A: &Mat3<T>, v: &Vec3<T>) -> Vec3<T> {
    [
        A[0][0] * v[0] + A[1][0] * v[1] + A[2][0] * v[2],
        A[0][1] * v[0] + A[1][1] * v[1] + A[2][1] * v[2],
        A[0][2] * v[0] + A[1][2] * v[1] + A[2][2] * v[2],
    ]
}

/// `Aᵀ v`.
#[inline(always)]
pub fn transposed_product<T: Real>(A: &Mat3<T>, v: &Vec3<T>) -> Vec3<T> {
    [dot(&A[0], v), dot(&A[1], v), dot(&A[2], v)]
}
