//! A rigid sphere pressed into a block, at five depths, against a converged solution.
//!
//! Block 0.10 x 0.10 x 0.05 m, base clamped, neo-Hookean with `E = 10 kPa`, Poisson ratio 0.40; sphere of 40 mm above the
//! centre of the top face, frictionless. The converged forces are those of quadratic hexahedra with contact integrated
//! on faces, by an independent code, good to about 1.5 %.

use std::path::Path;

use miette::{Result, miette};
use nalgebra::{Isometry3, Vector3};
use palpate::fem::block::block;
use palpate::fem::element::ElementKind;
use palpate::fem::mesh::TetMesh;
use palpate::prelude::*;
use palpate::step::StepStatus;

use super::body::{REFRESH, time_per_step};
use crate::chart::plot::{Mark, Series};

/// Depths (m).
pub(crate) const DEPTHS: [f64; 5] = [0.001, 0.002, 0.004, 0.006, 0.008];

/// Converged forces (N) at [`DEPTHS`].
pub(crate) const CONVERGED: [f64; 5] = [0.1124, 0.3401, 1.0234, 1.9950, 3.1935];

const SIDE: f64 = 0.10;
const HEIGHT: f64 = 0.05;
const RADIUS: f64 = 0.040;

/// Steps per second in search of equilibrium: so long that inertia and damping are nothing.
const STATIC_RATE: f64 = 0.05;

/// Most steps for one depth, and the relative change of the force from step to step at which the body rests.
const MOST_STEPS: usize = 60;
const SETTLED: f64 = 1e-5;

/// Contacts that a case may have.
const MOST_CONTACTS: usize = 400;

/// Groups of steps that are timed.
const GROUPS: usize = 10;

/// A block of `cells` (even) along each side and `layers` in height, finer below the sphere: the cell next to the centre of the
/// top is `1 / grading` of an even one, and those behind grow geometrically.
fn mesh(cells: usize, layers: usize, grading: f64) -> TetMesh {
    let half = graded(0.5 * SIDE, cells / 2, grading);
    let centre = 0.5 * SIDE;
    let mut side: Vec<f64> = half.iter().rev().map(|d| centre - d).collect();
    side.extend(half.iter().skip(1).map(|d| centre + d));
    let depth = graded(HEIGHT, layers, grading);
    let z: Vec<f64> = depth.iter().rev().map(|d| HEIGHT - d).collect();
    block(&side, &side, &z)
}

/// `cells + 1` distances from 0 to `length`; the first is `1 / grading` of an even one.
fn graded(length: f64, cells: usize, grading: f64) -> Vec<f64> {
    // The sum of a geometric row: the ratio by bisection, since the first term is given.
    let first = length / (cells as f64 * grading);
    let sum = |ratio: f64| (0..cells).map(|k| first * ratio.powi(k as i32)).sum::<f64>();
    let (mut low, mut high) = (1.0, 10.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if sum(middle) < length { low = middle } else { high = middle }
    }
    let mut at = 0.0;
    let mut places = vec![0.0];
    for k in 0..cells {
        at += first * high.powi(k as i32);
        places.push(at);
    }
    places.iter().map(|p| p * length / at).collect()
}

/// One choice of element, contact and mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Case {
    /// The element.
    pub(crate) element: ElementKind,
    /// Contact at `nodes` or `faces`, as in a scene.
    pub(crate) at: &'static str,
    cells: usize,
    layers: usize,
    grading: f64,
}

/// What is measured; with `quick`, coarse meshes alone.
pub(crate) fn cases(quick: bool) -> Vec<Case> {
    let mut cases = Vec::new();
    for element in ElementKind::ALL {
        // Cells of quadratic elements are twice as large: as many nodes.
        let half = if element == ElementKind::Quadratic { 2 } else { 1 };
        for at in ["nodes", "faces"] {
            for (cells, layers, grading) in [(8, 4, 1.0), (12, 6, 1.0), (16, 8, 1.0), (16, 8, 2.0), (24, 12, 2.0)] {
                // Contact on the faces of a fine mesh is hundreds of points, and no more exact.
                let large = quick && cells > 8 || at == "faces" && cells > 16;
                if !large {
                    cases.push(Case { element, at, cells: cells / half, layers: layers / half, grading });
                }
            }
        }
    }
    cases
}

/// What a case answers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Indentation {
    /// Force (N) at [`DEPTHS`].
    pub(crate) force: [f64; 5],
    /// Nodes of the body.
    pub(crate) nodes: usize,
    /// Time per step in real time (s).
    pub(crate) time: Option<f64>,
}

impl Indentation {
    /// Relative error of each force.
    pub(crate) fn errors(&self) -> [f64; 5] {
        std::array::from_fn(|k| self.force[k] / CONVERGED[k] - 1.0)
    }
}

impl Case {
    /// The mesh in words.
    pub(crate) fn name(&self) -> String {
        let Self { cells, layers, grading, .. } = self;
        format!("{cells} x {cells} x {layers}{}", if *grading > 1.0 { ", graded" } else { "" })
    }

    fn world(&self, more: &str, rate: f64) -> Result<World> {
        let (at, element) = (self.at, self.element.name());
        let text = format!(
            r#"
            name = "indentation"
            gravity = [0, 0, 0]
            [rates]
            step = {rate}
            factor = {rate}
            [[body]]
            name = "block"
            block = {{ min = [0, 0, 0], max = [{SIDE}, {SIDE}, {HEIGHT}], cells = [2, 2, 2] }}
            element = "{element}"
            density = 1000
            rayleigh_stiffness = 0.005
            material = {{ law = "neo_hookean", young = 10e3, poisson = 0.40 }}
            fixed = [{{ node_set = "z_min" }}]
            {more}
            [[tool]]
            name = "ball"
            shape = {{ kind = "sphere", radius = {RADIUS} }}
            [contact]
            at = "{at}"
            friction = 0
            max_contacts = {MOST_CONTACTS}
            [solver]
            tolerance = 1e-6
            max_sweeps = 2000
            [hand]
            path = [{{ time = 0, position = [0, 0, 0.2] }}]
            "#
        );
        let scene = Scene::from_toml(&text, Path::new(".")).map_err(|e| miette!("{e}"))?;
        scene.build_on(mesh(self.cells, self.layers, self.grading)).map_err(|e| miette!("{e}"))
    }

    /// Presses through all depths, each to equilibrium; then once more in real time, to take its time.
    pub(crate) fn press(&self) -> Result<Indentation> {
        let world = self.world("compliance = \"exact\"\ntolerance = 1e-8", STATIC_RATE)?;
        let mut sim = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
        let force = DEPTHS.map(|depth| equilibrium(&mut sim, depth).unwrap_or(f64::NAN));
        let world = self.world("", 30.0)?;
        let sim = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
        // Down to the last depth within half of the time, then rest.
        let depth = |step: u64| DEPTHS[4] * (2.0 * step as f64 / (GROUPS as u64 * REFRESH) as f64).min(1.0);
        let time = time_per_step(sim, GROUPS, |step| pose(depth(step)));
        Ok(Indentation { force, nodes: world.mesh().nodes.len(), time })
    }
}

fn pose(depth: f64) -> Isometry3<f64> {
    Isometry3::from(Vector3::new(0.5 * SIDE, 0.5 * SIDE, HEIGHT + RADIUS - depth))
}

/// Normal force (N) at rest; `None` where a step failed.
fn equilibrium(sim: &mut Simulation<'_>, depth: f64) -> Option<f64> {
    let mut before = f64::INFINITY;
    for _ in 0..MOST_STEPS {
        let report = sim.step(&pose(depth));
        if report.status != StepStatus::Advanced {
            return None;
        }
        let force = report.force.z;
        if (force - before).abs() < SETTLED * force.abs() {
            return Some(force);
        }
        before = force;
    }
    Some(before)
}

/// What other engines answer to the same problem: worst error (%) over the depths and time per step (ms) of one busy
/// core, on 1,183 nodes and 5,184 linear tetrahedra; measured on another machine of this kind, good to 40 %.
pub(crate) fn others() -> Vec<Series> {
    let point = |name: &str, time: f64, error: f64| Series {
        name: name.into(),
        mark: Mark::Points,
        points: vec![(time, error)],
    };
    vec![
        point("MuJoCo 4.0 flex, Newton", 119.0, 50.0),
        point("MuJoCo 4.0 flex, CG", 25.0, 73.0),
        point("Drake 1.51, linear corotated", 189.0, 60.0),
        point("Newton 1.8 VBD", 50.0, 24.0),
        point("PyBullet 3.2.7 neo-Hookean", 96.0, 27.0),
    ]
}
