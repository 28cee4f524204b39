//! Admissible forces as conic solvers take them.

/// A convex set of forces of one block, N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConicForm {
    /// All forces.
    Free,
    /// `lambda_n >= 0`.
    NonNegative,
    /// `0 <= lambda_n <= limit`.
    Interval {
        /// Largest force, N.
        limit: f64,
    },
    /// `|lambda_t| <= friction lambda_n`, a second-order cone.
    SecondOrder {
        /// Friction coefficient.
        friction: f64,
    },
    /// `lambda_n >= 0` and `|lambda_t| <= limit`: a half-line times a disc.
    Cylinder {
        /// Radius of the disc, N.
        limit: f64,
    },
    /// `lambda_t` in the polygon with `facets` corners on the circle of radius `friction lambda_n`, the first of them
    /// along `t`: a polyhedral cone.
    Polyhedral {
        /// Friction coefficient.
        friction: f64,
        /// Number of corners.
        facets: usize,
    },
}
