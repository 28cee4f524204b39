//! A law as an equation for Newton.
//!
//! The laws' admissible pairs are the zeros of `F(delta, lambda) = lambda - P(x)` with `x = lambda - rho delta` and `P`
//! piecewise smooth [Alart and Curnier 1991]. Where pieces meet, the derivatives are those of one of them.
//!
//! In the law's own tangential frame (along the slip and across it, or along a facet's normal and its side) each row of
//! `F` is of one of the kinds of [`RowEquation`]. Rows whose force is given are thereby taken out of a linear system
//! exactly: a contact that sticks leaves three unknowns, one that slides two, one that is open none.

use nalgebra::{Matrix3, Vector2, Vector3};

/// One row of a law's equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowEquation {
    /// The force is given, or a multiple of the normal force: `F = lambda_i - slope x_n - constant`. With a slope the
    /// normal row is closed, which turns the equation into `d lambda_i - slope d lambda_n = -excess`.
    Given {
        /// `lambda_i - slope lambda_n - constant`, N.
        excess: f64,
        /// Growth of the force with the normal force, dimensionless.
        slope: f64,
    },
    /// The gap is closed: `F = rho delta_i`.
    Closed {
        /// `rho delta_i`, N.
        value: f64,
    },
    /// The force turns with the slip: `dF = (1 - weight) d lambda_i + weight rho d delta_i`.
    Turning {
        /// `F`, N.
        value: f64,
        /// Part of the gap in the equation, in (0, 1).
        weight: f64,
    },
}

/// `F` and its derivatives at one pair, row by row in the frame of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linearization {
    /// The rows: normal, along [`Linearization::axis`], across it.
    pub rows: [RowEquation; 3],
    /// Unit vector of the second row in the tangential plane; `(1, 0)` where the law has no frame of its own. The third
    /// row is a quarter turn further.
    pub axis: Vector2<f64>,
}

impl Linearization {
    /// `F = lambda`: the rows carry no force.
    #[inline]
    pub(super) fn without_force(lambda: &Vector3<f64>) -> Self {
        let given = |excess| RowEquation::Given { excess, slope: 0.0 };
        Self { rows: [given(lambda.x), given(lambda.y), given(lambda.z)], axis: Vector2::x() }
    }

    /// `F = rho delta` in one row: the row is closed. Expects the frame of the rows themselves.
    #[inline]
    pub(super) fn close(&mut self, row: usize, rho: f64, delta: &Vector3<f64>) {
        self.rows[row] = RowEquation::Closed { value: rho * delta[row] };
    }

    /// `F_t = lambda_t - P(x_t)` with `P` the projection onto the disc of radius `limit + slope x_n` (N); a slope only
    /// where the normal row is closed.
    ///
    /// `P = radius x / |x|` has the derivatives `radius / |x| (1 - u u^T)` and, by the radius, `u = x / |x|`.
    #[inline]
    pub(super) fn disc(&mut self, limit: f64, slope: f64, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) {
        let x = lambda - delta * rho;
        let size = x.yz().norm();
        let radius = limit + slope * x.x;
        // Without friction the rows carry no force, as they stand.
        if radius <= 0.0 {
            return;
        }
        if size <= radius {
            self.close(1, rho, delta);
            self.close(2, rho, delta);
            return;
        }
        let u = x.yz() / size;
        let (along, across) = in_frame(&u, lambda);
        let weight = radius / size;
        self.axis = u;
        self.rows[1] = RowEquation::Given { excess: along - limit - slope * lambda.x, slope };
        self.rows[2] = RowEquation::Turning { value: across, weight };
    }

    /// The force along `axis` is `slope` times the normal force, which is closed, and that across it `closed` or none.
    #[inline]
    pub(super) fn facet(
        &mut self,
        axis: Vector2<f64>,
        slope: f64,
        closed: bool,
        rho: f64,
        delta: &Vector3<f64>,
        lambda: &Vector3<f64>,
    ) {
        let (along, across) = in_frame(&axis, lambda);
        self.axis = axis;
        self.rows[1] = RowEquation::Given { excess: along - slope * lambda.x, slope };
        self.rows[2] = if closed {
            RowEquation::Closed { value: rho * in_frame(&axis, delta).1 }
        } else {
            RowEquation::Given { excess: across, slope: 0.0 }
        };
    }

    /// The axes of the rows as columns: a rotation about the normal.
    #[must_use]
    pub fn frame(&self) -> Matrix3<f64> {
        let u = self.axis;
        Matrix3::new(1.0, 0.0, 0.0, 0.0, u.x, -u.y, 0.0, u.y, u.x)
    }

    /// `F` in the contact's own rows, N.
    #[must_use]
    pub fn value(&self) -> Vector3<f64> {
        let closed = match self.rows[0] {
            RowEquation::Closed { value } => value,
            _ => 0.0,
        };
        let rows = self.rows.map(|row| match row {
            RowEquation::Given { excess, slope } => excess + slope * closed,
            RowEquation::Closed { value } | RowEquation::Turning { value, .. } => value,
        });
        self.frame() * Vector3::from(rows)
    }

    /// `dF / d lambda` (dimensionless) and `dF / d delta` (N/m) in the contact's own rows, for the `rho` (N/m) of the
    /// linearization.
    #[must_use]
    pub fn derivatives(&self, rho: f64) -> (Matrix3<f64>, Matrix3<f64>) {
        let (mut by_lambda, mut by_delta) = (Matrix3::zeros(), Matrix3::zeros());
        for (i, row) in self.rows.iter().enumerate() {
            let weight = match *row {
                RowEquation::Given { slope, .. } => {
                    by_lambda[(i, 0)] -= slope;
                    by_delta[(i, 0)] += slope * rho;
                    0.0
                }
                RowEquation::Closed { .. } => 1.0,
                RowEquation::Turning { weight, .. } => weight,
            };
            by_lambda[(i, i)] += 1.0 - weight;
            by_delta[(i, i)] += weight * rho;
        }
        let frame = self.frame();
        (frame * by_lambda * frame.transpose(), frame * by_delta * frame.transpose())
    }
}

/// Tangential entries along an axis and across it.
#[inline]
fn in_frame(axis: &Vector2<f64>, v: &Vector3<f64>) -> (f64, f64) {
    (axis.x * v.y + axis.y * v.z, axis.x * v.z - axis.y * v.y)
}
