//! The equations of one contact in the linear system of a Newton step, in single precision.
//!
//! ```text
//! T (W d) + own x = v ,   d = D x                          up to three unknowns x, forces d, gaps W d
//! ```
//!
//! With `g` the gaps that the forces of other contacts make, and `N = (T W_aa D + own)^-1`, its unknowns are
//! `x = N (v - T g)`. `N` is part of a preconditioner and of nothing else, so that its rounding harms nobody. The products of the matrices are formed once, so that only one of them stands between the gaps of a
//! contact and its forces: that is what the next contact waits for.

#![allow(non_snake_case)]

/// Three numbers and a zero, as the processor's vectors take them.
pub(crate) type Quad = [f32; 4];

/// A 3 x 3 matrix by columns.
pub(crate) type Columns = [Quad; 3];

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
    /// From `T`, `D` and the diagonal block `W_aa`; unknowns that the contact does not have are zero rows
    /// and columns with an `own` of one. A singular block gets numbers that are not finite.
    #[inline(always)]
    pub(crate) fn new(place: usize, rows: usize, T: &Columns, D: &Columns, own: &Quad, W: &Columns) -> Self {
        let mut M = product(T, &product(W, D));
        for (i, column) in M.iter_mut().enumerate() {
            column[i] += own[i];
        }
        let N = inverse(&M);
        let NT = product(&N, T);
        Self {
            place,
            rows,
            tests: *T,
            own: *own,
            inverse: N,
            reduced: NT,
            answer: product(D, &N),
            response: product(D, &NT),
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

/// `A B`.
#[inline(always)]
fn product(A: &Columns, B: &Columns) -> Columns {
    [times(A, &B[0]), times(A, &B[1]), times(A, &B[2])]
}

/// The inverse, by the adjugate; infinite or undefined where there is none.
#[inline(always)]
pub(crate) fn inverse(A: &Columns) -> Columns {
    let cross = |a: &Quad, b: &Quad| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let rows = [cross(&A[1], &A[2]), cross(&A[2], &A[0]), cross(&A[0], &A[1])];
    let determinant = A[0][0] * rows[0][0] + A[0][1] * rows[0][1] + A[0][2] * rows[0][2];
    let factor = 1.0 / determinant;
    let mut columns = [[0.0; 4]; 3];
    for (j, column) in columns.iter_mut().enumerate() {
        for (entry, row) in column.iter_mut().zip(&rows) {
            *entry = row[j] * factor;
        }
    }
    columns
}
