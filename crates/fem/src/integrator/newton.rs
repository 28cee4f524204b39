//! Newton's method with line search on a [`Potential`].
//!
//! Each iteration factors the exact tangent. Only where that is not positive definite is the filtered one taken, and only
//! where that is singular as well (tissue without mass that nothing holds, flattened elements) is its diagonal raised:
//! the report counts both. The direction then descends, and is halved until the potential falls by Armijo's measure.
//! Near the minimum, where the fall drowns in the rounding of the energy, the slope at the trial point decides instead
//! [Hager, Zhang 2005].

#![allow(non_snake_case)]

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::{
    dot, norm,
    potential::{Line, Potential},
};
use crate::{
    assembly::{AssemblyReport, FemWorkspace},
    factor::{Factor, FactorStatus, SolveWorkspace, SymbolicFactor},
    model::{FemModel, FemState},
    sparse::SystemMatrix,
};

/// Share of the slope by which the potential must fall (Armijo).
const SUFFICIENT: f64 = 1e-4;

/// Largest slope at the trial point, relative to that at the begin, where the energy is too coarse to compare.
const FLAT: f64 = 0.9;

/// Halvings of one direction: 2^-30 of it is below the rounding of positions.
const MOST_CUTS: u32 = 30;

/// Raises of the diagonal of one matrix: from 1e-8 of its mean, tenfold each, to a hundred times.
const MOST_RAISES: u32 = 11;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewtonConfig {
    /// Most iterations (linear solves), at least 1.
    pub iterations: u32,
    /// Bound on the residual, relative to the forces that it balances; positive.
    pub tolerance: f64,
}

impl Default for NewtonConfig {
    /// 1e-9 within 50 iterations: quadratic convergence makes the last digits cheap, and a reference wants them.
    fn default() -> Self {
        Self { iterations: 50, tolerance: 1e-9 }
    }
}

/// How the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewtonStatus {
    /// The residual is within tolerance, or at the rounding of the forces.
    Converged,
    /// The iterations are used up; the state is the best so far.
    OutOfIterations,
    /// No multiple of the direction lowers the potential; the state is the best so far.
    Stalled,
    /// No matrix could be factored; the state is the best so far.
    Singular,
    /// A force, a tangent or a motion is not finite; the state is the best so far, or untouched.
    NonFinite,
}

/// What Newton's method did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewtonReport {
    /// How it ended.
    pub status: NewtonStatus,
    /// Linear solves.
    pub iterations: u32,
    /// `‖r‖` (N) at the end.
    pub residual: f64,
    /// The same, relative to the forces that it balances.
    pub relative_residual: f64,
    /// Halvings of all line searches.
    pub cuts: u32,
    /// By how much the potential fell (J).
    pub decrease: f64,
    /// Iterations that needed the filtered tangent.
    pub filtered: u32,
    /// Iterations that needed a raised diagonal.
    pub raised: u32,
    /// The last assembly.
    pub assembly: AssemblyReport,
}

impl NewtonReport {
    /// Before the first iteration.
    pub(super) fn begin() -> Self {
        Self {
            status: NewtonStatus::OutOfIterations,
            iterations: 0,
            residual: f64::INFINITY,
            relative_residual: f64::INFINITY,
            cuts: 0,
            decrease: 0.0,
            filtered: 0,
            raised: 0,
            assembly: AssemblyReport::NONE,
        }
    }

    /// True for [`NewtonStatus::Converged`].
    pub fn is_converged(&self) -> bool {
        self.status == NewtonStatus::Converged
    }
}

/// Scratch of implicit steps and of equilibria.
pub struct ImplicitWorkspace {
    /// Forces and matrix of the last assembly.
    pub fem: FemWorkspace,
    /// The factor of the last linear solve.
    pub factor: Factor,
    pub(super) solve: SolveWorkspace,
    /// `K0`, where there is stiffness damping.
    pub(super) damping: Option<SystemMatrix>,
    /// Configuration `q0` at the begin of the step, or of the path of loads (m).
    pub(super) start: Vec<Vector3<f64>>,
    /// `q̃` of a step (m); the last equilibrium of a path.
    pub(super) predicted: Vec<Vector3<f64>>,
    /// Configuration from which a line is searched (m).
    pub(super) base: Vec<Vector3<f64>>,
    pub(super) residual: Vec<f64>,
    pub(super) direction: Vec<f64>,
    pub(super) moved: Vec<f64>,
    pub(super) product: Vec<f64>,
    /// Farthest that an iteration may move a node (m).
    reach: f64,
    /// Whether every iteration takes the filtered tangent.
    filtered: bool,
    /// Places of the diagonal blocks.
    diagonal: Vec<u32>,
}

impl ImplicitWorkspace {
    /// Memory for a body whose pattern has been analysed.
    pub fn new(model: &FemModel, symbolic: &Arc<SymbolicFactor>) -> Self {
        let zeros = vec![0.0; 3 * model.free_nodes()];
        let damped = model.rayleigh_stiffness() > 0.0;
        let place = |i: u32| model.pattern().find(i, i).map_or(u32::MAX, |p| p as u32);
        Self {
            fem: FemWorkspace::new(model),
            factor: Factor::new(Arc::clone(symbolic)),
            solve: SolveWorkspace::new(symbolic),
            damping: damped.then(|| SystemMatrix::zeros(model.pattern().clone())),
            start: model.q_rest().to_vec(),
            predicted: model.q_rest().to_vec(),
            base: model.q_rest().to_vec(),
            residual: zeros.clone(),
            direction: zeros.clone(),
            moved: zeros.clone(),
            product: zeros,
            reach: f64::INFINITY,
            filtered: false,
            diagonal: (0..model.free_nodes() as u32).map(place).collect(),
        }
    }

    /// Memory for steps of tissue in trouble, begun crushed or inside out: filtered tangents throughout, no iteration moves
    /// a node by more than `reach` (m), and stiffness damping is left out. That of crushed tissue is as large as its
    /// tangent, and since fixed nodes count as resting it would hold tissue shut between an end that moves and the rest.
    pub fn careful(model: &FemModel, symbolic: &Arc<SymbolicFactor>, reach: f64) -> Self {
        Self { damping: None, reach, filtered: true, ..Self::new(model, symbolic) }
    }

    /// The diagonal blocks of the last matrix.
    fn diagonal_blocks(&self) -> impl Iterator<Item = &Matrix3<f64>> {
        self.diagonal.iter().filter_map(|&p| self.fem.system.blocks.get(p as usize))
    }

    /// Rounding of the forces (N): positions of size `|q|` times the stiffness, in the last binary digits.
    fn rounding(&self, state: &FemState, scale: f64) -> f64 {
        let size = state.q.iter().map(Vector3::amax).fold(0.0, f64::max);
        let stiffness: f64 = self.diagonal_blocks().map(|b| b.diagonal().norm_squared()).sum();
        4.0 * f64::EPSILON * size * stiffness.sqrt() / (scale * scale)
    }

    /// Rounding of the energy (J). Energies of elements are sums of terms that cancel at small strain: each is known to
    /// the last digits of its stiffness times the square of its length, here the size of the body over `∛n`.
    fn energy_rounding(&self, state: &FemState, scale: f64) -> f64 {
        let size = state.q.iter().map(Vector3::amax).fold(0.0, f64::max);
        let stiffness: f64 = self.diagonal_blocks().map(|b| b.trace().abs()).sum();
        let length = size / (self.diagonal.len().max(1) as f64).cbrt();
        8.0 * f64::EPSILON * stiffness * (length / scale).powi(2)
    }
}

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

/// Moves `state` along `ws.direction` to where the potential is lower; a status where it is not.
fn search(
    potential: &Potential<'_>,
    state: &mut FemState,
    ws: &mut ImplicitWorkspace,
    report: &mut NewtonReport,
) -> Option<NewtonStatus> {
    ws.base.copy_from_slice(&state.q);
    let before = potential.elastic(state, &ws.fem.folds);
    let line = potential.along(ws);
    let noise = 8.0 * f64::EPSILON * before.abs() + ws.energy_rounding(state, potential.scale());
    let farthest = ws.direction.chunks_exact(3).map(|d| Vector3::new(d[0], d[1], d[2]).norm()).fold(0.0, f64::max);
    let mut t = if farthest > ws.reach { ws.reach / farthest } else { 1.0 };
    for cut in 0..=MOST_CUTS {
        step_to(potential.model, t, state, ws);
        if let Some(fall) = accept(potential, &line, [before, noise], t, state, ws) {
            report.cuts += cut;
            report.decrease += fall;
            return None;
        }
        t *= 0.5;
    }
    report.cuts += MOST_CUTS;
    state.q.copy_from_slice(&ws.base);
    Some(NewtonStatus::Stalled)
}

/// `q = base + t d` at the free nodes.
fn step_to(model: &FemModel, t: f64, state: &mut FemState, ws: &ImplicitWorkspace) {
    for (d, &node) in ws.direction.chunks_exact(3).zip(model.node_of_free()) {
        let node = node as usize;
        state.q[node] = ws.base[node] + Vector3::new(d[0], d[1], d[2]) * t;
    }
}

/// The fall of the potential (J) where the trial point is good enough.
fn accept(
    potential: &Potential<'_>,
    line: &Line,
    [before, noise]: [f64; 2],
    t: f64,
    state: &FemState,
    ws: &mut ImplicitWorkspace,
) -> Option<f64> {
    let after = potential.elastic(state, &ws.fem.folds);
    let change = after - before + t * (line.linear + 0.5 * t * line.quadratic);
    if change <= SUFFICIENT * t * line.slope {
        return Some(-change);
    }
    // Not `>`: NaN is refused too.
    let hidden = change <= noise;
    if !hidden {
        return None;
    }
    // The residual at the trial point overwrites the one at the base, which the next cut does not need.
    potential.residual_at(state, ws);
    let slope = -dot(&ws.residual, &ws.direction);
    (slope.abs() <= FLAT * line.slope.abs()).then_some(-change)
}
