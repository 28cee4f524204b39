//! What a compliance matrix looks like, before anything is solved with it.

use nalgebra::DMatrixView;

/// What the matrix looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComplianceReport {
    /// Rows `m`.
    pub rows: usize,
    /// Least and greatest diagonal entry [m/N]; both 0 without rows.
    pub diagonal: [f64; 2],
    /// `max |W - Wᵀ| / max |W|`.
    pub asymmetry: f64,
    /// There was a valid inverse, every entry is finite, and every diagonal entry positive.
    pub usable: bool,
}

/// What a compliance matrix looks like.
pub fn judge(w: DMatrixView<'_, f64>) -> ComplianceReport {
    let rows = w.nrows();
    let mut report = ComplianceReport { rows, diagonal: [0.0; 2], asymmetry: 0.0, usable: true };
    if rows == 0 {
        return report;
    }
    let (mut greatest, mut skew) = (0.0f64, 0.0f64);
    report.diagonal = [f64::INFINITY, f64::NEG_INFINITY];
    for j in 0..rows {
        report.diagonal = [report.diagonal[0].min(w[(j, j)]), report.diagonal[1].max(w[(j, j)])];
        report.usable &= w[(j, j)] > 0.0;
        for i in 0..rows {
            report.usable &= w[(i, j)].is_finite();
            greatest = greatest.max(w[(i, j)].abs());
            skew = skew.max((w[(i, j)] - w[(j, i)]).abs());
        }
    }
    report.asymmetry = if greatest > 0.0 { skew / greatest } else { 0.0 };
    report
}
