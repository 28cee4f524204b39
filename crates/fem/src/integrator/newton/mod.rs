//! Newton's method with line search on a [`Potential`].
//!
//! Each iteration factors the exact tangent. Only where that is not positive definite is the filtered one taken, and only
//! where that is singular as well (tissue without mass that nothing holds, flattened elements) is its diagonal raised:
//! the report counts both. The direction then descends, and is halved until the potential falls by Armijo's measure.
//! Near the minimum, where the fall drowns in the rounding of the energy, the slope at the trial point decides instead
//! [Hager, Zhang 2005].

#![allow(non_snake_case)]

mod line_search;
mod report;
mod workspace;

pub use self::{
    report::{NewtonConfig, NewtonReport, NewtonStatus},
    workspace::ImplicitWorkspace,
};

use self::line_search::search;
use super::{norm, potential::Potential};
use crate::{factor::FactorStatus, model::FemState};

/// Raises of the diagonal of one matrix: from 1e-8 of its mean, tenfold each, to a hundred times.
const MOST_RAISES: u32 = 11;

/// Lowers `potential` from `state` by Newton's method; `begin` must have been called for a step. Allocates nothing.
pub(super) fn minimise(
    potential: &Potential<'_>,
    config: &NewtonConfig,
    state: &mut FemState,
    ws: &mut ImplicitWorkspace,
) -> NewtonReport {
    let mut report = NewtonReport::begin();
    loop {
        report.assembly = potential.matrix(state, ws.filtered, ws);
        let scale = potential.residual(state, ws);
        report.residual = norm(&ws.residual);
        report.relative_residual = if report.residual > 0.0 { report.residual / scale } else { 0.0 };
        if report.assembly.non_finite.is_some() || !report.residual.is_finite() {
            report.status = NewtonStatus::NonFinite;
            return report;
        }
        let rounding = ws.rounding(state, potential.scale());
        if report.residual <= config.tolerance * scale || report.residual <= rounding {
            report.status = NewtonStatus::Converged;
            return report;
        }
        if report.iterations >= config.iterations {
            report.status = NewtonStatus::OutOfIterations;
            return report;
        }
        report.iterations += 1;
        if let Err(status) = direction(potential, state, ws, &mut report) {
            report.status = status;
            return report;
        }
        if let Some(status) = search(potential, state, ws, &mut report) {
            report.status = status;
            return report;
        }
    }
}

/// Factors the matrix of the last assembly: exact, else filtered, else raised.
pub(super) fn factor_definite(
    potential: &Potential<'_>,
    state: &FemState,
    ws: &mut ImplicitWorkspace,
    report: &mut NewtonReport,
) -> Result<(), NewtonStatus> {
    let refactor = |ws: &mut ImplicitWorkspace| match ws.factor.refactor(&ws.fem.system).status {
        FactorStatus::Ok => Ok(true),
        FactorStatus::NotPositiveDefinite { .. } => Ok(false),
        FactorStatus::NonFinite { .. } | FactorStatus::OtherPattern => Err(NewtonStatus::NonFinite),
    };
    if refactor(ws)? {
        return Ok(());
    }
    report.filtered += 1;
    report.assembly = potential.matrix(state, true, ws);
    if refactor(ws)? {
        return Ok(());
    }
    report.raised += 1;
    let mean = ws.diagonal_blocks().map(|b| b.trace().abs()).sum::<f64>() / (3 * ws.diagonal.len().max(1)) as f64;
    let mut raise = 1e-8 * mean;
    for _ in 0..MOST_RAISES {
        for &p in &ws.diagonal {
            if let Some(block) = ws.fem.system.blocks.get_mut(p as usize) {
                (0..3).for_each(|c| block[(c, c)] += raise);
            }
        }
        if refactor(ws)? {
            return Ok(());
        }
        raise *= 10.0;
    }
    Err(NewtonStatus::Singular)
}

/// `ws.direction = h A⁻¹ h r`.
fn direction(
    potential: &Potential<'_>,
    state: &FemState,
    ws: &mut ImplicitWorkspace,
    report: &mut NewtonReport,
) -> Result<(), NewtonStatus> {
    factor_definite(potential, state, ws, report)?;
    let h = potential.scale();
    ws.direction.iter_mut().zip(&ws.residual).for_each(|(d, r)| *d = h * h * r);
    if !ws.factor.solve(&mut ws.direction, &mut ws.solve).is_ok() {
        return Err(NewtonStatus::Singular);
    }
    if ws.direction.iter().all(|d| d.is_finite()) { Ok(()) } else { Err(NewtonStatus::NonFinite) }
}
