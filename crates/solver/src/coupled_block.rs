//! The equations of one contact in the linear system of a Newton step, in single precision.
//!
//! ```text
//! T (W d) + own x = v ,   d = D x                          up to three unknowns x, forces d, gaps W d
//! ```
//!
//! With `g` the gaps that the forces of other contacts make, and `N = (T W_aa D + own)^-1`, its unknowns are
//! `x = N (v - T g)`. The products of the matrices are formed once, so that only one of them stands between the gaps of a
//! contact and its forces: that is what the next contact waits for.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

/// Three numbers and a zero, as the processor's vectors take them.
pub(crate) type Quad = [f32; 4];

/// A 3 x 3 matrix by columns.
type Columns = [Quad; 3];

/// The equations of a contact.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CoupledBlock {
    /// First row of the contact in the compliance.
    pub(crate) place: usize,
    /// Rows of the contact.
    pub(crate) rows: usize,
    /// `T`.
    pub(crate) tests: Columns,
    /// Factors of the unknowns in their own equations.
    pub(crate) own: Quad,
    /// `N`.
    inverse: Columns,
    /// `N T`.
    reduced: Columns,
    /// `D N`.
    answer: Columns,
    /// `D N T`.
    response: Columns,
}

impl CoupledBlock {
    /// From `T` by rows, `D` by columns and the diagonal block `W_aa`; unknowns that the contact does not have are zero rows
    /// and columns with an `own` of one. A singular block gets numbers that are not finite.
    pub(crate) fn new(
        place: usize,
        rows: usize,
        T: &Matrix3<f64>,
        D: &Matrix3<f64>,
        own: &Vector3<f64>,
        W: &Matrix3<f64>,
    ) -> Self {
        let N = (T * W * D + Matrix3::from_diagonal(own)).try_inverse().unwrap_or(Matrix3::repeat(f64::NAN));
        let NT = N * T;
        Self {
            place,
            rows,
            tests: single(T),
            own: quad(own),
            inverse: single(&N),
            reduced: single(&NT),
            answer: single(&(D * N)),
            response: single(&(D * NT)),
        }
    }

    /// The forces `d` and the unknowns `x` for a right side and the gaps that are there.
    #[inline(always)]
    pub(crate) fn substitute(&self, v: &Quad, gap: &Quad) -> (Quad, Quad) {
        let (mut force, response) = (times(&self.answer, v), times(&self.response, gap));
        let (mut unknowns, reduced) = (times(&self.inverse, v), times(&self.reduced, gap));
        for i in 0..4 {
            force[i] -= response[i];
            unknowns[i] -= reduced[i];
        }
        (force, unknowns)
    }

    /// The gaps of the contact's rows.
    #[inline(always)]
    pub(crate) fn read(&self, gap: &[f32]) -> Quad {
        match gap.get(self.place..).unwrap_or(&[]) {
            [a, b, c, ..] if self.rows == 3 => [*a, *b, *c, 0.0],
            [a, b, ..] if self.rows == 2 => [*a, *b, 0.0, 0.0],
            [a, ..] => [*a, 0.0, 0.0, 0.0],
            [] => [0.0; 4],
        }
    }
}

/// `A x`.
#[inline(always)]
pub(crate) fn times(A: &Columns, x: &Quad) -> Quad {
    let mut y = [0.0; 4];
    for i in 0..4 {
        y[i] = A[0][i] * x[0] + A[1][i] * x[1] + A[2][i] * x[2];
    }
    y
}

fn quad(v: &Vector3<f64>) -> Quad {
    [v.x as f32, v.y as f32, v.z as f32, 0.0]
}

fn single(A: &Matrix3<f64>) -> Columns {
    std::array::from_fn(|j| quad(&A.column(j).into()))
}
