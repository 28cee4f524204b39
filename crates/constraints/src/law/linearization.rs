//! A law as an equation for Newton.
//!
//! The laws' admissible pairs are the zeros of `F(delta, lambda) = lambda - P(x)` with `x = lambda - rho delta` and `P`
//! piecewise smooth [Alart and Curnier 1991]. Where pieces meet, the derivatives are those of one of them.

use nalgebra::{Matrix3, Vector2, Vector3};

/// `F` and its derivatives at one pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linearization {
    /// `F`, N.
    pub value: Vector3<f64>,
    /// `dF / d lambda`, dimensionless.
    pub by_lambda: Matrix3<f64>,
    /// `dF / d delta`, N/m.
    pub by_delta: Matrix3<f64>,
}

impl Linearization {
    /// `F = 0`, to be filled row by row.
    pub(super) fn zero() -> Self {
        Self { value: Vector3::zeros(), by_lambda: Matrix3::zeros(), by_delta: Matrix3::zeros() }
    }

    /// `F = lambda`: the rows carry no force.
    #[inline]
    pub(super) fn without_force(lambda: &Vector3<f64>) -> Self {
        Self { value: *lambda, by_lambda: Matrix3::identity(), by_delta: Matrix3::zeros() }
    }

    /// `F = rho delta` in one row: the row is closed.
    #[inline]
    pub(super) fn close(&mut self, row: usize, rho: f64, delta: &Vector3<f64>) {
        self.value[row] = rho * delta[row];
        self.by_lambda[(row, row)] = 0.0;
        self.by_delta[(row, row)] = rho;
    }

    /// `F_t = lambda_t - P(x_t)` with `P` the projection onto the disc of radius `radius` (N), which grows by `growth`
    /// with `x_n`.
    #[inline]
    pub(super) fn disc(&mut self, radius: f64, growth: f64, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) {
        let x = (lambda - delta * rho).yz();
        let size = x.norm();
        if size <= radius {
            self.close(1, rho, delta);
            self.close(2, rho, delta);
            return;
        }
        let (u, v) = (x.x / size, x.y / size);
        let g = radius / size;
        // P = radius x / |x|:  dP/dx = radius / |x| (1 - u u^T),  dP/dradius = u.
        let dp = [[g * v * v, -g * u * v], [-g * u * v, g * u * u]];
        self.tangential(&Vector2::new(radius * u, radius * v), &dp, &Vector2::new(growth * u, growth * v), rho, lambda);
    }

    /// `F_t = lambda_t - P` for a projection with the derivatives `by_x` and `by_normal` (with `x_n`).
    #[inline]
    pub(super) fn tangential(
        &mut self,
        projection: &Vector2<f64>,
        by_x: &[[f64; 2]; 2],
        by_normal: &Vector2<f64>,
        rho: f64,
        lambda: &Vector3<f64>,
    ) {
        for i in 0..2 {
            self.value[i + 1] = lambda[i + 1] - projection[i];
            for j in 0..2 {
                self.by_lambda[(i + 1, j + 1)] = f64::from(u8::from(i == j)) - by_x[i][j];
                self.by_delta[(i + 1, j + 1)] = rho * by_x[i][j];
            }
            self.by_lambda[(i + 1, 0)] = -by_normal[i];
            self.by_delta[(i + 1, 0)] = rho * by_normal[i];
        }
    }
}
