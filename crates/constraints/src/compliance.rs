//! Compliance in constraint space.
//!
//! `W = h² H A⁻¹ Hᵀ` [m/N]: how far the gap of one row opens per newton on another within a step. `A` is in kg, `H` has
//! no unit, and the factor `h²` appears here and nowhere else. The matching correction of the motion is
//! `Δv = h A⁻¹ Hᵀ λ` [m/s].
//!
//! The asynchronous method has only the factor of an older matrix `A₀`, taken when the tissue was turned differently.
//! With `R` the block-diagonal matrix of the nodes' rotations since then, `A⁻¹ ≈ R A₀⁻¹ Rᵀ` (compliance warping: Saupin,
//! Duriez, Cotin, Grisoni, CGI 2008), hence `W ≈ h² (H R) A₀⁻¹ (H R)ᵀ` and `Δv ≈ h R A₀⁻¹ (H R)ᵀ λ`. Exact where the
//! tissue has only turned as a whole. The contact law holds exactly for any symmetric positive `W`; its error is one of
//! accuracy, never of feasibility.

use nalgebra::{DMatrixViewMut, Matrix3};
use palpate_fem::factor::{Factor, ReachStatus, ReachWorkspace};
use palpate_fem::nodal_rows::NodalRows;
use serde::{Deserialize, Serialize};

pub use crate::compliance_report::{ComplianceReport, judge};

/// How `W` is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ComplianceMethod {
    /// Left to whoever plans the run; as an inverse, what [`ComplianceMethod::Asynchronous`] is.
    #[default]
    Automatic,
    /// From the latest factor of the background thread, warped by the rotations of the nodes since.
    #[serde(rename = "async", alias = "asynchronous")]
    Asynchronous,
    /// From a factor of this step's matrix.
    Exact,
    /// From the first matrix, warped by the rotations of the nodes since: nothing is ever factored again. Gathered from
    /// its inverse between the nodes of the skin ([`SurfaceInverse`](crate::surface_inverse::SurfaceInverse)) where that
    /// has room.
    Warped,
}

impl ComplianceMethod {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Automatic, Self::Exact, Self::Asynchronous, Self::Warped];

    /// Name in scenes and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Automatic => "automatic",
            Self::Asynchronous => "async",
            Self::Exact => "exact",
            Self::Warped => "warped",
        }
    }
}

/// How the contact forces move the body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MotionCorrection {
    /// By `A` of this step: `A Δv = h Hᵀ λ` is solved by conjugate gradients. The motion obeys the equations of motion
    /// whatever `W` was; what `W` misses remains as a gap, which the next step sees.
    #[default]
    Exact,
    /// By the inverse that gave `W`: the gaps are those that the contact law was solved for, whatever `A` is. An old
    /// inverse then moves inner nodes wrongly, which feeds energy into a body that is pressed deep and fast.
    Matching,
}

impl MotionCorrection {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Exact, Self::Matching];

    /// Name in scenes and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Matching => "matching",
        }
    }
}

/// A symmetric positive definite matrix that can apply its inverse to sparse rows.
///
/// Implemented by the sparse factor; a dense inverse serves as well.
pub trait InverseRows {
    /// Scratch memory; also keeps what `correct` needs from the latest `compliance_into`.
    type Workspace;

    /// `w = scale H A⁻¹ Hᵀ` into a matrix of size `m x m`; false where there is no valid inverse.
    fn compliance_into(
        &self,
        rows: &NodalRows,
        scale: f64,
        w: DMatrixViewMut<'_, f64>,
        ws: &mut Self::Workspace,
    ) -> bool;

    /// `x = A⁻¹ Hᵀ λ`, with the rows of the latest `compliance_into` on this workspace; false where that does not fit.
    fn correct(&self, lambda: &[f64], x: &mut [f64], ws: &mut Self::Workspace) -> bool;

    /// As [`Self::correct`], as roughly as a first guess of an iteration may be.
    fn guess(&self, lambda: &[f64], x: &mut [f64], ws: &mut Self::Workspace) -> bool {
        self.correct(lambda, x, ws)
    }
}

impl InverseRows for Factor {
    type Workspace = ReachWorkspace;

    fn compliance_into(
        &self,
        rows: &NodalRows,
        scale: f64,
        w: DMatrixViewMut<'_, f64>,
        ws: &mut ReachWorkspace,
    ) -> bool {
        Factor::compliance_into(self, rows, scale, w, ws).status == ReachStatus::Ok
    }

    fn correct(&self, lambda: &[f64], x: &mut [f64], ws: &mut ReachWorkspace) -> bool {
        Factor::correct(self, lambda, x, ws).is_ok()
    }

    fn guess(&self, lambda: &[f64], x: &mut [f64], ws: &mut ReachWorkspace) -> bool {
        self.guess_correction(lambda, x, ws).is_ok()
    }
}

impl<T: InverseRows> InverseRows for &T {
    type Workspace = T::Workspace;

    fn compliance_into(&self, rows: &NodalRows, scale: f64, w: DMatrixViewMut<'_, f64>, ws: &mut T::Workspace) -> bool {
        T::compliance_into(self, rows, scale, w, ws)
    }

    fn correct(&self, lambda: &[f64], x: &mut [f64], ws: &mut T::Workspace) -> bool {
        T::correct(self, lambda, x, ws)
    }

    fn guess(&self, lambda: &[f64], x: &mut [f64], ws: &mut T::Workspace) -> bool {
        (**self).guess(lambda, x, ws)
    }
}

/// The inverse that a method uses.
#[derive(Clone, Copy, Debug)]
pub struct WarpedInverse<'a, I> {
    /// [`ComplianceMethod::Exact`]: of this step's matrix. Otherwise: of an older one.
    pub inverse: I,
    /// Rotation of each free node since the factor was taken, from then to now; none for the exact method.
    pub rotations: Option<&'a [Matrix3<f64>]>,
}

impl<'a, I> WarpedInverse<'a, I> {
    /// The inverse as the method wants it: the exact method has nothing to warp.
    pub fn new(method: ComplianceMethod, inverse: I, rotations: &'a [Matrix3<f64>]) -> Self {
        match method {
            ComplianceMethod::Exact => Self { inverse, rotations: None },
            _ => Self { inverse, rotations: Some(rotations) },
        }
    }
}

/// Memory for compliance and correction.
#[derive(Clone, Debug)]
pub struct ComplianceWorkspace<W> {
    rotated: NodalRows,
    inverse: W,
    /// The body's own part of `W`, before it is added.
    own: Vec<f64>,
}

impl<W> ComplianceWorkspace<W> {
    /// Memory for `rows` rows of up to three nodes, and the inverse's own workspace.
    pub fn new(rows: usize, inverse: W) -> Self {
        Self { rotated: NodalRows::with_capacity(rows, 3), inverse, own: vec![0.0; rows * rows] }
    }

    /// The inverse's own workspace.
    pub fn inverse(&self) -> &W {
        &self.inverse
    }

    /// The same, to change it.
    pub fn inverse_mut(&mut self) -> &mut W {
        &mut self.inverse
    }
}

/// `rows <- H R`: the value `v` at node `k` becomes `R_kᵀ v`, since `(H R)_k = v_kᵀ R_k`.
///
/// Nodes beyond the rotations keep their values.
pub fn rotate_rows(rows: &mut NodalRows, rotations: &[Matrix3<f64>]) {
    rows.map_values(|node, value| rotations.get(node as usize).map_or(value, |r| r.tr_mul(&value)));
}

/// Assembles `W = h² H A⁻¹ Hᵀ` (m/N) of one body's rows for the step `dt` (s) into the `m x m` matrix `w`.
pub fn assemble<'w, I: InverseRows>(
    system: WarpedInverse<'_, I>,
    rows: &NodalRows,
    dt: f64,
    w: impl Into<DMatrixViewMut<'w, f64>>,
    ws: &mut ComplianceWorkspace<I::Workspace>,
) -> ComplianceReport {
    let mut w = w.into();
    if w.shape() != (rows.len(), rows.len()) {
        return ComplianceReport { rows: rows.len(), diagonal: [0.0; 2], asymmetry: 0.0, usable: false };
    }
    let valid = write(system, rows, dt, w.as_view_mut(), &mut ws.rotated, &mut ws.inverse);
    let report = judge(w.as_view());
    ComplianceReport { usable: report.usable && valid, ..report }
}

/// Adds what [`assemble`] would write to `w`; false where there is no valid inverse or no room.
pub fn add<I: InverseRows>(
    system: WarpedInverse<'_, I>,
    rows: &NodalRows,
    dt: f64,
    w: &mut DMatrixViewMut<'_, f64>,
    ws: &mut ComplianceWorkspace<I::Workspace>,
) -> bool {
    let m = rows.len();
    let Some(own) = ws.own.get_mut(..m * m) else { return false };
    if w.shape() != (m, m) {
        return false;
    }
    let view = DMatrixViewMut::from_slice(&mut *own, m, m);
    let valid = write(system, rows, dt, view, &mut ws.rotated, &mut ws.inverse);
    for (mut column, own) in w.column_iter_mut().zip(own.chunks_exact(m.max(1))) {
        column.iter_mut().zip(own).for_each(|(w, own)| *w += own);
    }
    valid
}

/// Writes `W` of one body; false where there is no valid inverse.
fn write<I: InverseRows>(
    system: WarpedInverse<'_, I>,
    rows: &NodalRows,
    dt: f64,
    w: DMatrixViewMut<'_, f64>,
    rotated: &mut NodalRows,
    ws: &mut I::Workspace,
) -> bool {
    let Some(rotations) = system.rotations else {
        return system.inverse.compliance_into(rows, dt * dt, w, ws);
    };
    rotated.clear();
    for r in 0..rows.len() {
        rotated.push_row(rows.row(r));
    }
    rotate_rows(rotated, rotations);
    system.inverse.compliance_into(rotated, dt * dt, w, ws)
}

/// Correction `Δv = h A⁻¹ Hᵀ λ` [m/s] of the free nodes for the rows of the latest [`assemble`]; overwrites `delta_v`.
///
/// False, and no correction, where the inverse has changed since or the lengths do not fit.
pub fn correct<I: InverseRows>(
    system: WarpedInverse<'_, I>,
    lambda: &[f64],
    dt: f64,
    delta_v: &mut [f64],
    ws: &mut ComplianceWorkspace<I::Workspace>,
) -> bool {
    let found = system.inverse.correct(lambda, delta_v, &mut ws.inverse);
    finish(system, dt, found, delta_v)
}

/// As [`correct`], for an exact correction that begins there: by a rougher copy of the inverse where it has one.
pub fn guess<I: InverseRows>(
    system: WarpedInverse<'_, I>,
    lambda: &[f64],
    dt: f64,
    delta_v: &mut [f64],
    ws: &mut ComplianceWorkspace<I::Workspace>,
) -> bool {
    let found = system.inverse.guess(lambda, delta_v, &mut ws.inverse);
    finish(system, dt, found, delta_v)
}

/// Turns `A₀⁻¹ Hᵀ λ` where it was found into `h R A₀⁻¹ Hᵀ λ`.
fn finish<I>(system: WarpedInverse<'_, I>, dt: f64, found: bool, delta_v: &mut [f64]) -> bool {
    if !found {
        delta_v.fill(0.0);
        return false;
    }
    for (k, x) in delta_v.chunks_exact_mut(3).enumerate() {
        let v = nalgebra::Vector3::new(x[0], x[1], x[2]) * dt;
        let v = system.rotations.and_then(|all| all.get(k)).map_or(v, |r| r * v);
        x.copy_from_slice(v.as_slice());
    }
    true
}
