//! Static equilibrium: `f_int(q) + s (f_ext + M g) = 0` at the free nodes, with fixed nodes moved to where they are told.
//!
//! Loads and prescribed displacements grow together from where they are to their full size. The first attempt takes
//! them in one step; where Newton's method does not converge, the step is undone and halved, and doubled again after
//! each success. Where fixed nodes move, each step begins with the tangent's answer to their motion: moving them alone
//! would crush the elements beside them.

#![allow(non_snake_case)]

mod error;
mod loads;

use nalgebra::Vector3;

pub use self::{
    error::EquilibriumError,
    loads::{Loads, Prescribed},
};

use super::{
    newton::{ImplicitWorkspace, NewtonConfig, NewtonReport, NewtonStatus, factor_definite, minimise},
    nodal,
    potential::Potential,
};
use crate::{
    assembly::{advance_memory, internal_forces},
    model::{FemModel, FemState},
    sparse::FIXED,
};

/// Share of a prescribed motion by which the tangent's answer is probed: far above rounding, far below any strain.
const PROBE: f64 = 1e-6;

/// How equilibrium is sought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EquilibriumConfig {
    /// Newton's method at each load.
    pub newton: NewtonConfig,
    /// First load step, in (0, 1]: the share of the path.
    pub first_step: f64,
    /// Load step below which the path ends, positive.
    pub smallest_step: f64,
}

impl Default for EquilibriumConfig {
    /// The whole load at once; down to a thousandth of it.
    fn default() -> Self {
        Self {
            newton: NewtonConfig { iterations: 30, ..NewtonConfig::default() },
            first_step: 1.0,
            smallest_step: 1e-3,
        }
    }
}

impl EquilibriumConfig {
    /// Checks the ranges that the fields state.
    ///
    /// # Errors
    /// [`EquilibriumError::Step`] and [`EquilibriumError::Newton`].
    pub fn validate(&self) -> Result<(), EquilibriumError> {
        let default = Self::default();
        // Written so that NaN is in no range.
        if !(self.first_step > 0.0 && self.first_step <= 1.0) {
            let range = "first load step is a share of the path, above 0 and at most 1";
            let (name, value, default) = ("first_step", self.first_step, default.first_step);
            return Err(EquilibriumError::Step { name, value, range, default });
        }
        if !(self.smallest_step > 0.0 && self.smallest_step.is_finite()) {
            let range = "load step at which the path ends is a positive share of it";
            let (name, value, default) = ("smallest_step", self.smallest_step, default.smallest_step);
            return Err(EquilibriumError::Step { name, value, range, default });
        }
        if self.newton.iterations == 0 {
            return Err(EquilibriumError::Newton { name: "iterations", value: 0.0, range: "allow at least 1" });
        }
        let tolerance = self.newton.tolerance;
        if !(tolerance > 0.0 && tolerance < 1.0) {
            let range = "give a share of the forces between 0 and 1, such as 1e-9";
            return Err(EquilibriumError::Newton { name: "tolerance", value: tolerance, range });
        }
        Ok(())
    }
}

/// How far the loads came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EquilibriumReport {
    /// Newton's method at the last load that was tried.
    pub newton: NewtonReport,
    /// Share of the path that was reached: 1 where the equilibrium was found. The state is in equilibrium with it.
    pub reached: f64,
    /// Load steps that converged.
    pub load_steps: u32,
    /// Load steps that were undone and halved.
    pub halvings: u32,
    /// Linear solves of all load steps.
    pub iterations: u32,
    /// Line-search cuts of all load steps.
    pub cuts: u32,
    /// Iterations that needed the filtered tangent, of all load steps.
    pub filtered: u32,
    /// Iterations that needed a raised diagonal, of all load steps.
    pub raised: u32,
    /// Sum of the forces that hold the fixed nodes (N); minus the weight and the forces where the body is in equilibrium.
    pub reaction: Vector3<f64>,
}

impl EquilibriumReport {
    /// True where the whole load is carried.
    pub fn is_converged(&self) -> bool {
        self.reached >= 1.0
    }
}

/// Moves `state` into equilibrium and takes its velocity away. Allocates nothing.
///
/// Trouble is in the report: the state is then the last equilibrium that was found on the way.
///
/// # Errors
/// Loads that do not suit the model, settings out of their range; the state is untouched.
pub fn equilibrium(
    model: &FemModel,
    loads: &Loads<'_>,
    config: &EquilibriumConfig,
    state: &mut FemState,
    ws: &mut ImplicitWorkspace,
) -> Result<EquilibriumReport, EquilibriumError> {
    config.validate()?;
    loads.check(model)?;
    let mut report = EquilibriumReport {
        newton: NewtonReport::begin(),
        reached: 0.0,
        load_steps: 0,
        halvings: 0,
        iterations: 0,
        cuts: 0,
        filtered: 0,
        raised: 0,
        reaction: Vector3::zeros(),
    };
    state.v.fill(Vector3::zeros());
    ws.start.copy_from_slice(&state.q);
    let load_at = |s: f64| loads.carried + s * (1.0 - loads.carried);
    let mut step = config.first_step;
    while report.reached < 1.0 {
        let target = if report.reached + step > 1.0 - 1e-12 { 1.0 } else { report.reached + step };
        ws.predicted.copy_from_slice(&state.q);
        let potential = Potential { model, f_ext: loads.f_ext, load: load_at(target), dt: None };
        let mut newton = NewtonReport::begin();
        if predict(&potential, loads, target, target - report.reached, state, ws, &mut newton).is_ok() {
            let (filtered, raised) = (newton.filtered, newton.raised);
            newton = minimise(&potential, &config.newton, state, ws);
            (newton.filtered, newton.raised) = (newton.filtered + filtered, newton.raised + raised);
        } else {
            newton.status = NewtonStatus::Singular;
        }
        report.newton = newton;
        report.iterations += newton.iterations;
        report.cuts += newton.cuts;
        report.filtered += newton.filtered;
        report.raised += newton.raised;
        if newton.is_converged() {
            report.reached = target;
            report.load_steps += 1;
            step *= 2.0;
            continue;
        }
        state.q.copy_from_slice(&ws.predicted);
        report.halvings += 1;
        step = 0.5 * (target - report.reached);
        if step < config.smallest_step {
            break;
        }
    }
    let potential = Potential { model, f_ext: loads.f_ext, load: load_at(report.reached), dt: None };
    potential.residual_at(state, ws);
    advance_memory(model, state, f64::INFINITY);
    let fixed = (0..model.nodes()).filter(|&i| model.free_of_node()[i] == FIXED);
    report.reaction = fixed.map(|node| reaction(&potential, node, ws)).sum();
    Ok(report)
}

/// Force that holds a fixed node (N): minus what the tissue and the loads exert on it, from the forces of the last
/// evaluation in `ws`. Zero for free nodes of a body in equilibrium, up to the residual.
pub fn reaction(potential: &Potential<'_>, node: usize, ws: &ImplicitWorkspace) -> Vector3<f64> {
    -ws.fem.f_int[node] - potential.external(node) * potential.load
}

/// Moves fixed nodes to the share `target` of their paths, and the free ones as the tangent answers to this motion of
/// share `step` and to the loads.
fn predict(
    potential: &Potential<'_>,
    loads: &Loads<'_>,
    target: f64,
    step: f64,
    state: &mut FemState,
    ws: &mut ImplicitWorkspace,
    report: &mut NewtonReport,
) -> Result<(), NewtonStatus> {
    if loads.prescribed.is_empty() {
        return Ok(());
    }
    let model = potential.model;
    potential.matrix(state, false, ws);
    factor_definite(potential, state, ws, report)?;
    potential.residual(state, ws);
    ws.direction.copy_from_slice(&ws.residual);
    // f_int(q, u + ε Δu) - f_int(q, u), over ε.
    for p in loads.prescribed {
        let node = p.node as usize;
        state.q[node] += (p.position - ws.start[node]) * (PROBE * step);
    }
    for (k, &node) in model.node_of_free().iter().enumerate() {
        ws.moved[3 * k..3 * k + 3].copy_from_slice(ws.fem.f_int[node as usize].as_slice());
    }
    internal_forces(model, state, &mut ws.fem);
    for (k, &node) in model.node_of_free().iter().enumerate().filter(|(k, _)| !model.held()[*k]) {
        let change = (ws.fem.f_int[node as usize] - nodal(&ws.moved, k)) / PROBE;
        (0..3).for_each(|c| ws.direction[3 * k + c] += change[c]);
    }
    for p in loads.prescribed {
        let node = p.node as usize;
        state.q[node] = ws.start[node] + (p.position - ws.start[node]) * target;
    }
    if !ws.factor.solve(&mut ws.direction, &mut ws.solve).is_ok() || !ws.direction.iter().all(|d| d.is_finite()) {
        return Err(NewtonStatus::Singular);
    }
    for (k, &node) in model.node_of_free().iter().enumerate() {
        state.q[node as usize] += nodal(&ws.direction, k);
    }
    Ok(())
}
