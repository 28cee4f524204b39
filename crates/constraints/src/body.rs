//! Bodies in the contact problem: `W = Σ h² H A⁻¹ Hᵀ` over all of them, and what the forces do to each.
//!
//! A body knows its own part of the rows, its own `A` and how to apply `A⁻¹`; the problem knows only the sum. Called a
//! few times a step, so a trait object.

use nalgebra::{DMatrixViewMut, Matrix3};

use crate::compliance::{self, ComplianceReport, ComplianceWorkspace, InverseRows, WarpedInverse};
use crate::rows::{ContactRows, Twist};

/// A body that rows act on.
pub trait Body {
    /// Adds `h² H A⁻¹ Hᵀ` \[m/N\] of the body's part of the rows to the `m x m` matrix `w`, for a step `dt` \[s\]; false where
    /// the body has no valid inverse.
    fn add_compliance(&mut self, rows: &ContactRows, dt: f64, w: &mut DMatrixViewMut<'_, f64>) -> bool;

    /// Replaces the body's correction by `h A⁻¹ Hᵀ λ`, for the rows of the latest [`Body::add_compliance`]; false, and none,
    /// where that does not fit.
    fn correct(&mut self, rows: &ContactRows, lambda: &[f64], dt: f64) -> bool;
}

/// `W` of all bodies into `w`, and what it looks like.
pub fn assemble<'w>(
    bodies: &mut [&mut dyn Body],
    rows: &ContactRows,
    dt: f64,
    w: impl Into<DMatrixViewMut<'w, f64>>,
) -> ComplianceReport {
    let mut w = w.into();
    w.fill(0.0);
    let mut valid = w.shape() == (rows.len(), rows.len());
    if valid {
        for body in bodies {
            valid &= body.add_compliance(rows, dt, &mut w);
        }
    }
    let report = compliance::judge(w.as_view());
    ComplianceReport { usable: report.usable && valid, ..report }
}

/// A soft body: an inverse that serves sparse rows, exact, warped or lumped.
pub struct SoftBody<'a, I: InverseRows> {
    /// Its inverse.
    pub inverse: WarpedInverse<'a, I>,
    /// Memory for its compliance and correction.
    pub workspace: &'a mut ComplianceWorkspace<I::Workspace>,
    /// `Δv` of its free nodes [m/s].
    pub correction: &'a mut [f64],
}

impl<I: InverseRows + Copy> Body for SoftBody<'_, I> {
    fn add_compliance(&mut self, rows: &ContactRows, dt: f64, w: &mut DMatrixViewMut<'_, f64>) -> bool {
        compliance::add(self.inverse, &rows.tissue, dt, w, self.workspace)
    }

    fn correct(&mut self, _rows: &ContactRows, lambda: &[f64], dt: f64) -> bool {
        compliance::correct(self.inverse, lambda, dt, self.correction, self.workspace)
    }
}

/// The inverse of a rigid body's 6 x 6 matrix `A = diag(m, I)` about its centre of mass, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidInverse {
    /// `1 / m` [1/kg].
    pub mass: f64,
    /// `I⁻¹` [1/(kg m²)].
    pub inertia: Matrix3<f64>,
}

impl RigidInverse {
    /// `A⁻¹ x` of a wrench, or of one row.
    pub fn apply(&self, x: &Twist) -> Twist {
        Twist { linear: x.linear * self.mass, angular: self.inertia * x.angular }
    }
}

/// All rigid bodies together; their `A` is block diagonal.
pub struct RigidBodies<'a> {
    /// `A⁻¹` of each.
    pub inverse: &'a [RigidInverse],
    /// `Δv` and `Δω` of each.
    pub correction: &'a mut [Twist],
}

impl Body for RigidBodies<'_> {
    fn add_compliance(&mut self, rows: &ContactRows, dt: f64, w: &mut DMatrixViewMut<'_, f64>) -> bool {
        if rows.rigid.touches_nothing() {
            return true;
        }
        let mut valid = true;
        for j in 0..rows.len() {
            for (body, row) in rows.rigid.row(j) {
                let Some(inverse) = self.inverse.get(*body as usize) else {
                    valid = false;
                    continue;
                };
                let moved = inverse.apply(&Twist { linear: row.force, angular: row.torque });
                // The upper triangle, mirrored: W stays symmetric to the bit.
                for i in 0..=j {
                    for (_, other) in rows.rigid.row(i).iter().filter(|(other, _)| other == body) {
                        let value = dt * dt * other.dot(&moved.linear, &moved.angular);
                        w[(i, j)] += value;
                        if i != j {
                            w[(j, i)] += value;
                        }
                    }
                }
            }
        }
        valid
    }

    fn correct(&mut self, rows: &ContactRows, lambda: &[f64], dt: f64) -> bool {
        self.correction.fill(Twist::default());
        if lambda.len() != rows.rigid.len() || self.correction.len() != self.inverse.len() {
            return false;
        }
        rows.rigid.add_transposed(lambda, self.correction);
        for (x, inverse) in self.correction.iter_mut().zip(self.inverse) {
            let moved = inverse.apply(x);
            *x = Twist { linear: moved.linear * dt, angular: moved.angular * dt };
        }
        true
    }
}
