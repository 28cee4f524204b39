//! The diagonal block `W_aa` of the compliance, in the form that exact local solves want.
//!
//! The normal row is eliminated once,
//!
//! ```text
//! W_aa = | W_nn  w^T  |      S = W_tt - w w^T / W_nn = V diag(sigma_1, sigma_2) V^T ,   V a rotation
//!        | w     W_tt |
//! ```
//!
//! so that `(S + s I)^-1 c`, which friction needs for many `s`, costs two divisions and is backward stable.
//!
//! The block held here is positive definite even where the given one is not: it is symmetrised, and a block whose
//! condition number exceeds 1 / [`COMPLIANCE_FLOOR`] is shifted by that fraction of its largest diagonal entry, which
//! bounds every local force by `|b| / (COMPLIANCE_FLOOR max_i W_ii)`. A solver that forms `b` with
//! [`LocalCompliance::gap`] from its current gap and force (`b = delta - gap(lambda)`) keeps its fixed points exact all
//! the same, since there the block's own contribution cancels: the shift then only bounds the step.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Smallest eigenvalue of a block, relative to its largest diagonal entry. Below the inverse condition number of blocks
/// that contacts produce (1e-4 and above), far above rounding.
pub const COMPLIANCE_FLOOR: f64 = 1e-9;

/// `W_aa` with its normal row eliminated and its tangential part diagonalised, m/N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalCompliance {
    /// `W_nn`, m/N; zero for a block without compliance.
    pub(super) nn: f64,
    /// `1 / W_nn`, N/m; zero for a block without compliance.
    pub(super) inv_nn: f64,
    /// Coupling `w` of the normal row to the tangential rows, m/N.
    pub(super) nt: Vector2<f64>,
    /// Tangential block `W_tt`, m/N.
    pub(super) tt: Matrix2<f64>,
    /// Eigenvalues of the Schur complement `S`, m/N.
    pub(super) sigma: Vector2<f64>,
    /// First column `(cos, sin)` of `V`.
    axis: Vector2<f64>,
    /// `1 / mean diagonal`, N/m.
    rho: f64,
}

impl Default for LocalCompliance {
    fn default() -> Self {
        Self::without_compliance()
    }
}

impl LocalCompliance {
    /// From the diagonal block of a law with `rows` rows; entries beyond them are not read.
    #[allow(non_snake_case)]
    pub fn new(W: &Matrix3<f64>, rows: usize) -> Self {
        let largest = (0..rows.min(3)).fold(0.0_f64, |largest, i| largest.max(W[(i, i)]));
        let readable = (0..rows.min(3)).all(|i| (0..rows.min(3)).all(|j| W[(i, j)].is_finite()));
        if rows == 0 || !readable || largest < f64::MIN_POSITIVE {
            return Self::without_compliance();
        }
        // Rows that the block does not have: uncoupled, as compliant as the normal row.
        let mut nn = W[(0, 0)];
        let mut nt = Vector2::zeros();
        let mut tt = Matrix2::from_diagonal_element(nn);
        if rows >= 2 {
            nt.x = 0.5 * (W[(0, 1)] + W[(1, 0)]);
            tt[(0, 0)] = W[(1, 1)];
        }
        if rows >= 3 {
            nt.y = 0.5 * (W[(0, 2)] + W[(2, 0)]);
            tt[(1, 1)] = W[(2, 2)];
            tt[(0, 1)] = 0.5 * (W[(1, 2)] + W[(2, 1)]);
            tt[(1, 0)] = tt[(0, 1)];
        }
        let (mut sigma, mut axis) = schur(nn, &nt, &tt);
        let floor = COMPLIANCE_FLOOR * largest;
        if trace_of_inverse(nn, &nt, &sigma, &axis) * floor > 1.0 {
            nn = nn.max(0.0) + floor;
            tt += Matrix2::from_diagonal_element(floor);
            (sigma, axis) = schur(nn, &nt, &tt);
            // Only an indefinite block is still below the floor.
            sigma = sigma.map(|eigenvalue| eigenvalue.max(floor));
            tt = from_eigen(&sigma, &axis) + nt * nt.transpose() / nn;
        }
        Self { nn, inv_nn: 1.0 / nn, nt, tt, sigma, axis, rho: natural_stiffness(W, rows) }
    }

    /// A block that no force moves.
    pub fn without_compliance() -> Self {
        Self {
            nn: 0.0,
            inv_nn: 0.0,
            nt: Vector2::zeros(),
            tt: Matrix2::zeros(),
            sigma: Vector2::zeros(),
            axis: Vector2::x(),
            rho: 1.0,
        }
    }

    /// Whether no force moves the block.
    #[inline]
    pub fn is_rigid(&self) -> bool {
        self.inv_nn == 0.0
    }

    /// The block's own contribution to its gap, `W_aa lambda`, in m.
    #[inline]
    pub fn gap(&self, lambda: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(
            self.nn * lambda.x + self.nt.x * lambda.y + self.nt.y * lambda.z,
            self.nt.x * lambda.x + self.tt[(0, 0)] * lambda.y + self.tt[(0, 1)] * lambda.z,
            self.nt.y * lambda.x + self.tt[(1, 0)] * lambda.y + self.tt[(1, 1)] * lambda.z,
        )
    }

    /// Stiffness that turns the block's gaps into forces in the natural map, N/m: see [`natural_stiffness`].
    #[inline]
    pub fn rho(&self) -> f64 {
        self.rho
    }

    /// Normal force (N) that closes the gap `b_n` (m), or none if it is open.
    #[inline]
    pub(super) fn normal_force(&self, b_n: f64) -> f64 {
        let lambda_n = -b_n * self.inv_nn;
        // Also maps NaN and overflow to no force.
        if lambda_n > 0.0 && lambda_n.is_finite() { lambda_n } else { 0.0 }
    }

    /// `-W_aa^-1 b`: the force (N) that brings all rows to zero gap; zero for a block without compliance.
    #[inline]
    pub(super) fn closing_force(&self, b: &Vector3<f64>) -> Vector3<f64> {
        if self.is_rigid() {
            return Vector3::zeros();
        }
        let c = self.rotated(&self.reduced(b));
        let tangential = self.rotated_back(&-c.component_div(&self.sigma));
        Vector3::new(-(b.x + self.nt.dot(&tangential)) * self.inv_nn, tangential.x, tangential.y)
    }

    /// `c = b_t - w b_n / W_nn`: tangential gap once the normal row is closed, m.
    #[inline]
    pub(super) fn reduced(&self, b: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(b.y, b.z) - self.nt * (b.x * self.inv_nn)
    }

    /// `V^T x`.
    #[inline]
    pub(super) fn rotated(&self, x: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.axis.x * x.x + self.axis.y * x.y, self.axis.x * x.y - self.axis.y * x.x)
    }

    /// `V x`.
    #[inline]
    pub(super) fn rotated_back(&self, x: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.axis.x * x.x - self.axis.y * x.y, self.axis.y * x.x + self.axis.x * x.y)
    }
}

/// `1 / mean diagonal` of a diagonal block, N/m: with it the natural map of a block has one scale, whatever the units
/// and the stiffness of its bodies. 1 for a block without compliance, whose force is zero.
#[allow(non_snake_case)]
pub fn natural_stiffness(W: &Matrix3<f64>, rows: usize) -> f64 {
    let trace: f64 = (0..rows.min(3)).map(|i| W[(i, i)]).sum();
    let rho = rows as f64 / trace;
    if rho.is_finite() && rho > 0.0 { rho } else { 1.0 }
}

/// Eigenvalues and axis of `S = W_tt - w w^T / W_nn`.
fn schur(nn: f64, nt: &Vector2<f64>, tt: &Matrix2<f64>) -> (Vector2<f64>, Vector2<f64>) {
    eigen(&(tt - nt * nt.transpose() / nn))
}

/// `trace(W_aa^-1)` in N/m, at least the inverse of the smallest eigenvalue; infinite where the block is not
/// positive definite.
fn trace_of_inverse(nn: f64, nt: &Vector2<f64>, sigma: &Vector2<f64>, axis: &Vector2<f64>) -> f64 {
    if nn.min(sigma.x).min(sigma.y) <= 0.0 {
        return f64::INFINITY;
    }
    let (x, y) = ((axis.x * nt.x + axis.y * nt.y) / nn, (axis.x * nt.y - axis.y * nt.x) / nn);
    1.0 / nn + (1.0 + x * x) / sigma.x + (1.0 + y * y) / sigma.y
}

/// Eigenvalues of a symmetric 2x2 matrix and its first eigenvector (one Jacobi rotation).
#[allow(non_snake_case)]
pub(super) fn eigen(S: &Matrix2<f64>) -> (Vector2<f64>, Vector2<f64>) {
    let (a, b, d) = (S[(0, 0)], S[(0, 1)], S[(1, 1)]);
    if b == 0.0 {
        return (Vector2::new(a, d), Vector2::x());
    }
    // t = tan of the smaller angle that annihilates b; finite for any a, d.
    let theta = (d - a) / (2.0 * b);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let cos = 1.0 / (t * t + 1.0).sqrt();
    (Vector2::new(a - t * b, d + t * b), Vector2::new(cos, -t * cos))
}

/// `V diag(sigma) V^T` with `axis` the first column of the rotation `V`.
fn from_eigen(sigma: &Vector2<f64>, axis: &Vector2<f64>) -> Matrix2<f64> {
    let (c, s) = (axis.x, axis.y);
    let off = (sigma.x - sigma.y) * c * s;
    Matrix2::new(sigma.x * c * c + sigma.y * s * s, off, off, sigma.x * s * s + sigma.y * c * c)
}
