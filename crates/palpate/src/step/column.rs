//! One column of the compliance against the exact one, the rows in turn.
//!
//! ```text
//! A y = Hᵀ e_j,   h² H y = W_A e_j          in the bodies that yield: tissue and rigid ones
//! ```

use std::time::{Duration, Instant};

use palpate_constraints::body::{Body, RigidBodies};
use palpate_constraints::compliance::{self, ComplianceMethod};
use palpate_fem::pcg::{PcgConfig, PcgStatus, pcg};

use super::preconditioner::StepPreconditioner;
use super::stages::inverse;
use super::{StepReport, StepStatus, StepWorkspace};
use crate::refresh::FactorSample;
use crate::world::World;

/// Relative residual at which a compared column counts as exact.
const SAMPLE_TOLERANCE: f64 = 1e-6;

/// Compares one column of a `W` that is not exact with the exact one, where it is time for that. Where the iterations that
/// the plan grants do not suffice no error is known, and the report says so; so it does where a step in real time, which
/// has its end, would be late for it.
pub(super) fn sample(world: &World, factor: &FactorSample, ws: &mut StepWorkspace, report: &mut StepReport) {
    let (m, plan) = (ws.rows.len(), world.plan().sampling);
    let measurable = report.compliance.usable && report.status == StepStatus::Advanced;
    if m == 0 || !plan.is_due(report.step) || !measurable || report.method == ComplianceMethod::Exact {
        return;
    }
    let row = plan.row(report.step, m);
    // A ladder chooses by what it finds, and a run that is played again must choose alike.
    let predicted = Duration::from_secs_f64(plan.iteration * plan.iterations as f64);
    if world.plan().ladder.is_none() && ws.end.is_some_and(|end| Instant::now() + predicted > end) {
        report.error.sample_left_out = true;
        return;
    }
    if !push(ws, row) {
        return;
    }
    ws.load.fill(0.0);
    ws.rows.tissue.add_transposed(&ws.lambda_of_sample[..m], &mut ws.load);
    let (inverse, _) = inverse(world, factor, None, None, ws.first.as_ref(), &ws.rotations);
    // Where there is no guess, the iterations begin at zero.
    compliance::guess(inverse, &ws.lambda_of_sample[..m], 1.0, &mut ws.sample, &mut ws.compliance);
    let config = PcgConfig { relative_tolerance: SAMPLE_TOLERANCE, max_iterations: plan.iterations };
    let mut preconditioner = StepPreconditioner::new(None, factor, &ws.rotations, &mut ws.solve);
    let solve = pcg(&ws.fem.system, &ws.load, &mut ws.sample, &mut preconditioner, config, &mut ws.pcg);
    report.error.sample_residual = solve.relative_residual;
    if solve.status != PcgStatus::Converged {
        report.error.sample_unconverged = true;
        return;
    }
    let w = ws.problem.view().column(row);
    if let Some(error) = error(m, |r| w[r], |r| entry(ws, r, &ws.sample)) {
        (report.error.sampled, report.error.sampled_row) = (error, row as u32);
    }
}

/// A unit force on a row into `ws.lambda_of_sample`, and the motion of rigid bodies under it into `ws.rigid.sample`.
pub(super) fn push(ws: &mut StepWorkspace, row: usize) -> bool {
    let Some(lambda) = ws.lambda_of_sample.get_mut(..ws.rows.len()) else { return false };
    lambda.fill(0.0);
    let Some(force) = lambda.get_mut(row) else { return false };
    *force = 1.0;
    let mut rigid = RigidBodies { inverse: &ws.rigid.inverse, correction: &mut ws.rigid.sample };
    rigid.correct(&ws.rows, lambda, 1.0)
}

/// Entry of row `r` (m/N) in the column of the force that was pushed with, where the tissue answers `y`.
pub(super) fn entry(ws: &StepWorkspace, r: usize, y: &[f64]) -> f64 {
    ws.dt * ws.dt * (ws.rows.tissue.dot(r, y) + ws.rows.rigid.dot(r, &ws.rigid.sample))
}

/// The largest error of a column, relative to the largest entry of the exact one; none of a column of zeros.
pub(super) fn error(rows: usize, found: impl Fn(usize) -> f64, exact: impl Fn(usize) -> f64) -> Option<f64> {
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for r in 0..rows {
        let truth = exact(r);
        worst = worst.max((found(r) - truth).abs());
        largest = largest.max(truth.abs());
    }
    (largest > 0.0).then(|| worst / largest)
}
