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

pub(super) const SIDE: f64 = 0.10;
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
    pub(super) cells: usize,
    pub(super) layers: usize,
    pub(super) grading: f64,
}

/// What is measured; with `quick`, coarse meshes alone.
pub(crate) fn cases(quick: bool) -> Vec<Case> {
    let mut cases = Vec::new();
    for element in ElementKind::ALL {
        // Cells of quadratic elements are twice as large: as many nodes.
        let half = if element == ElementKind::Quadratic { 2 } else { 1 };
        for at in ["nodes", "faces"] {
            for (cells, layers, grading) in [(8, 4, 1.0), (12, 6, 1.0), (16, 8, 1.0), (16, 8, 2.0), (20, 10, 4.0)] {
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
    /// Force (N) at [`DEPTHS`]; NaN where a step failed.
    pub(crate) force: [f64; 5],
    /// Whether the body came to rest at every depth.
    pub(crate) rests: bool,
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

    fn world(&self, law: &str, [body, contact]: [&str; 2], rate: f64, mesh: TetMesh) -> Result<World> {
        let (at, element) = (self.at, self.element.name());
        // Without it points on faces change with every step, and the force with them.
        let hold = at == "faces";
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
            material = {{ law = "{law}", young = 10e3, poisson = 0.40 }}
            fixed = [{{ node_set = "z_min" }}]
            {body}
            [[tool]]
            name = "ball"
            shape = {{ kind = "sphere", radius = {RADIUS} }}
            [contact]
            at = "{at}"
            hold = {hold}
            friction = 0
            {contact}
            max_contacts = {MOST_CONTACTS}
            [solver]
            tolerance = 1e-6
            max_sweeps = 2000
            [hand]
            path = [{{ time = 0, position = [0, 0, 0.2] }}]
            "#
        );
        let scene = Scene::from_toml(&text, Path::new(".")).map_err(|e| miette!("{e}"))?;
        scene.build_on(mesh).map_err(|e| miette!("{e}"))
    }

    /// Presses through all depths, each to equilibrium; then once more in real time, to take its time.
    pub(crate) fn press(&self) -> Result<Indentation> {
        let mesh = mesh(self.cells, self.layers, self.grading);
        let (force, rests) = self.forces("neo_hookean", "", mesh.clone(), &DEPTHS)?;
        Ok(Indentation { force, rests, nodes: self.nodes(), time: self.time("neo_hookean")? })
    }

    /// Nodes of its mesh.
    pub(crate) fn nodes(&self) -> usize {
        let mesh = mesh(self.cells, self.layers, self.grading);
        if self.element == ElementKind::Quadratic { mesh.promoted().nodes.len() } else { mesh.nodes.len() }
    }

    /// Force (N) of a law at 4 mm on our mesh; `None` where the body does not come to rest.
    pub(crate) fn force(&self, law: &str) -> Result<Option<f64>> {
        let mesh = mesh(self.cells, self.layers, self.grading);
        let ([force], rests) = self.forces(law, "", mesh, &[DEPTHS[2]])?;
        Ok((rests && force.is_finite()).then_some(force))
    }

    /// Normal forces (N) of a law on a mesh, one depth after the other, and whether all were at rest. `contact` are more lines
    /// of the scene's `[contact]`.
    pub(crate) fn forces<const N: usize>(
        &self,
        law: &str,
        contact: &str,
        mesh: TetMesh,
        depths: &[f64; N],
    ) -> Result<([f64; N], bool)> {
        let world = self.world(law, ["compliance = \"exact\"\ntolerance = 1e-8", contact], STATIC_RATE, mesh)?;
        let mut sim = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
        let mut rests = true;
        let force = depths.map(|depth| {
            let (force, rest) = equilibrium(&mut sim, depth);
            rests &= rest;
            force
        });
        Ok((force, rests))
    }

    /// Time per step (s) of a law while the sphere goes down to the last depth within half a second and stays there.
    pub(crate) fn time(&self, law: &str) -> Result<Option<f64>> {
        let world =
            self.world(law, ["compliance = \"asynchronous\"", ""], 30.0, mesh(self.cells, self.layers, self.grading))?;
        let sim = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
        let depth = |step: u64| DEPTHS[4] * (2.0 * step as f64 / (GROUPS as u64 * REFRESH) as f64).min(1.0);
        Ok(time_per_step(sim, GROUPS, |step| pose(depth(step))))
    }
}

/// The sphere `depth` (m) below the top.
fn pose(depth: f64) -> Isometry3<f64> {
    Isometry3::from(Vector3::new(0.5 * SIDE, 0.5 * SIDE, HEIGHT + RADIUS - depth))
}

/// Normal force (N) and whether the body is at rest; NaN where a step failed.
fn equilibrium(sim: &mut Simulation<'_>, depth: f64) -> (f64, bool) {
    let mut before = f64::INFINITY;
    for _ in 0..MOST_STEPS {
        let report = sim.step(&pose(depth));
        if report.status != StepStatus::Advanced {
            return (f64::NAN, false);
        }
        let force = report.force.z;
        if (force - before).abs() < SETTLED * force.abs() && report.solve.is_solved() {
            return (force, true);
        }
        before = force;
    }
    (before, false)
}

/// Two sizes of each element for every law, and one that is finer than all: contact at nodes.
pub(crate) fn of_every_law(quick: bool) -> (Vec<Case>, Case) {
    let case = |element, cells, layers, grading| Case { element, at: "nodes", cells, layers, grading };
    let mut cases = Vec::new();
    for element in ElementKind::ALL {
        let half = if element == ElementKind::Quadratic { 2 } else { 1 };
        for (cells, layers, grading) in [(8, 4, 1.0), (16, 8, 2.0)] {
            if !(quick && cells > 8) {
                cases.push(case(element, cells / half, layers / half, grading));
            }
        }
    }
    let finest = if quick { (6, 3, 2.0) } else { (10, 5, 4.0) };
    (cases, case(ElementKind::Quadratic, finest.0, finest.1, finest.2))
}

/// What other engines answer to the same problem: worst error (%) over the depths and time per step (ms) of one busy
/// core, on 1,183 nodes and 5,184 linear tetrahedra; measured on another machine of this kind, good to 40 %. Rapier
/// 0.36.1 lost contact in that set-up.
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
        point("Drake 1.51, neo-Hookean (1, 2 mm)", 302.0, 54.0),
        point("Newton 1.8 VBD", 50.0, 24.0),
        point("PyBullet 3.2.7 neo-Hookean", 96.0, 27.0),
    ]
}
