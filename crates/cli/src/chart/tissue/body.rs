//! A body without contact through the engine: its rest under gravity, and its time per step.

use std::path::Path;
use std::time::Duration;

use cpu_time::ThreadTime;
use miette::{Result, miette};
use nalgebra::{Isometry3, Vector3};
use palpate::fem::element::ElementKind;
use palpate::fem::mesh::TetMesh;
use palpate::prelude::*;
use palpate::step::StepStatus;

/// Steps between two refreshes of the factor: 30 Hz and 10 Hz.
pub(crate) const REFRESH: u64 = 3;

/// Where the tool waits, far from every body (m).
fn away() -> Isometry3<f64> {
    Isometry3::from(Vector3::repeat(10.0))
}

/// A body as a scene describes it.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    /// Law and parameters as in a scene: `{ law = "neo_hookean", ... }`.
    pub(crate) material: String,
    /// Kind of element.
    pub(crate) element: ElementKind,
    /// Density (kg/m³).
    pub(crate) density: f64,
    /// Acceleration of gravity (m/s²).
    pub(crate) gravity: [f64; 3],
    /// Fixed nodes as in a scene.
    pub(crate) fixed: String,
    /// Steps per second.
    pub(crate) rate: f64,
    /// Rayleigh damping: by mass (1/s), by stiffness (s).
    pub(crate) rayleigh: [f64; 2],
    /// Whether it begins at rest under its weight.
    pub(crate) settle: bool,
    /// Other lines of the body.
    pub(crate) more: &'static str,
}

impl Body {
    /// The body on a mesh, made ready.
    pub(crate) fn world(&self, mesh: TetMesh) -> Result<World> {
        let Self { material, element, density, gravity, fixed, rate, rayleigh, settle, more } = self;
        let text = format!(
            r#"
            name = "body"
            gravity = {gravity:?}
            [rates]
            step = {rate}
            factor = {rate}
            [[body]]
            name = "body"
            block = {{ min = [0, 0, 0], max = [1, 1, 1], cells = [1, 1, 1] }}
            element = "{}"
            density = {density}
            rayleigh_mass = {}
            rayleigh_stiffness = {}
            settle = {settle}
            compliance = "asynchronous"
            material = {material}
            fixed = [{fixed}]
            {more}
            [[tool]]
            name = "far away"
            shape = {{ kind = "sphere", radius = 0.001 }}
            [hand]
            path = [{{ time = 0, position = [10, 10, 10] }}]
            "#,
            element.name(),
            rayleigh[0],
            rayleigh[1],
        );
        let scene = Scene::from_toml(&text, Path::new(".")).map_err(|e| miette!("{e}"))?;
        scene.build_on(mesh).map_err(|e| miette!("{e}"))
    }
}

/// Median time (s) that one busy core works for a step, with its share of a refreshed factor every [`REFRESH`] steps,
/// after `groups` groups of steps; `None` where a step failed.
pub(crate) fn time_per_step(
    sim: Simulation<'_>,
    groups: usize,
    mut pose: impl FnMut(u64) -> Isometry3<f64>,
) -> Option<f64> {
    let mut sim = sim.refresh_every(REFRESH);
    let mut times = Vec::with_capacity(groups);
    let mut number = 0;
    for _ in 0..groups {
        // The pool has one thread, this one: what it works is all that is worked.
        let begin = ThreadTime::now();
        for _ in 0..REFRESH {
            if sim.step(&pose(number)).status != StepStatus::Advanced {
                return None;
            }
            number += 1;
        }
        times.push(begin.elapsed());
    }
    times.sort();
    times.get(groups / 2).map(|t: &Duration| t.as_secs_f64() / REFRESH as f64)
}

/// The same without a tool.
pub(crate) fn time_alone(sim: Simulation<'_>, groups: usize) -> Option<f64> {
    time_per_step(sim, groups, |_| away())
}

/// The body at rest under its weight; `None` where that was not found.
pub(crate) fn at_rest(world: &World) -> Option<Simulation<'_>> {
    Simulation::new(world).ok().filter(|sim| sim.settled().is_some_and(|report| report.is_converged()))
}

/// Positions (m) after `steps` steps from the scene's begin; `None` where a step failed.
pub(crate) fn positions_after(world: &World, steps: u64) -> Option<Vec<Vector3<f64>>> {
    let mut sim = Simulation::new(world).ok()?;
    for _ in 0..steps {
        if sim.step(&away()).status != StepStatus::Advanced {
            return None;
        }
    }
    Some(sim.positions().to_vec())
}
