//! A block of tissue beyond reason at 30 Hz: crushed, pulled, twisted, begun inside out or flat.

#![allow(dead_code, unreachable_pub)] // tests and surveys take what they need

use std::collections::HashMap;
use std::path::Path;

use nalgebra::{Isometry3, Rotation3, Vector3};
use palpate::fem::assembly::{FemWorkspace, internal_forces};
use palpate::fem::block::{block, evenly};
use palpate::fem::element::{ElementKind, Tetrahedron};
use palpate::fem::format::write_msh;
use palpate::fem::material::Material;
use palpate::fem::model::{FemModel, FemState};
use palpate::prelude::*;
use palpate::step::StepStatus;

/// Height of the block (m); its base is 4 cm wide.
pub const HEIGHT: f64 = 0.06;

/// Steps of the driven motion, of holding it, of the way back, and of rest after it.
pub const STEPS: [u32; 4] = [30, 10, 30, 90];

/// Share of the motion at the end of step `k`, counted from 1: out, held, back, rest.
pub fn share(k: u32) -> f64 {
    let [out, hold, back, _] = STEPS;
    (f64::from(k) / f64::from(out)).min(1.0) - (f64::from(k.saturating_sub(out + hold)) / f64::from(back)).min(1.0)
}

/// What happens to the block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ordeal {
    Crushed,
    Pulled,
    Twisted,
    InsideOut,
    Flat,
}

pub const ORDEALS: [Ordeal; 5] = [Ordeal::Crushed, Ordeal::Pulled, Ordeal::Twisted, Ordeal::InsideOut, Ordeal::Flat];

impl Ordeal {
    /// Place of a node of the driven end at the share `s` of the motion.
    pub fn driven(self, x: Vector3<f64>, s: f64) -> Vector3<f64> {
        let axis = Vector3::new(0.02, 0.02, 0.0);
        match self {
            Self::Crushed => x - Vector3::z() * (0.8 * HEIGHT * s),
            Self::Pulled => x + Vector3::z() * (2.0 * HEIGHT * s),
            Self::Twisted => {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU * s);
                axis + turn * (x - axis)
            }
            Self::InsideOut | Self::Flat => x,
        }
    }

    /// Place of a free node at the begin.
    pub fn begun(self, x: Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::InsideOut => Vector3::new(x.x, x.y, HEIGHT - x.z),
            Self::Flat => Vector3::new(x.x, x.y, 0.5 * HEIGHT),
            _ => x,
        }
    }
}

/// What became of the block.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outcome {
    pub rolled_back: u32,
    /// Elements inside out at the end.
    pub inverted: u32,
    /// Elements that are held open at the end.
    pub held_open: u32,
    /// Inner edges that are not wound once at the end.
    pub tangled: u32,
    /// Steps at the end, without a gap, that named tissue as tangled, inside out or held open.
    pub named: u32,
    /// Steps that led the body.
    pub led: u32,
    /// Steps that began with an element inside out.
    pub steps_inverted: u32,
    /// Steps whose motion was repeated by Newton's method.
    pub repeated: u32,
    /// Largest distance of a node from its place at rest, relative to the height.
    pub astray: f64,
    /// Smallest volume ratio on the way.
    pub smallest: f64,
    /// Largest speed of a node at the end, in heights per second.
    pub speed: f64,
    /// Forces on the free nodes at the end, relative to those within the body.
    pub residual: f64,
}

impl Outcome {
    pub fn recovers(&self) -> bool {
        self.astray < 1e-3
    }

    /// In equilibrium somewhere, uninverted: what is left of the motion after seconds of damping moves a node by less than
    /// a thousandth of the height in a second, and forces are balanced to a thousandth.
    pub fn rests(&self) -> bool {
        self.inverted == 0 && self.speed < 1e-3 && self.residual < 1e-3
    }

    pub fn text(&self) -> String {
        let failed =
            if self.rolled_back > 0 { format!(" ({} steps rolled back)", self.rolled_back) } else { String::new() };
        let shape = if self.recovers() {
            "recovers".into()
        } else {
            format!(
                "stays {:.0} % astray, {} inverted, {} held open, {} edges tangled, {:.0e} heights/s, residual {:.0e}",
                100.0 * self.astray,
                self.inverted,
                self.held_open,
                self.tangled,
                self.speed,
                self.residual
            )
        };
        let led = if self.led > 0 { format!(" ({} steps led)", self.led) } else { String::new() };
        format!("{shape}{failed}{led}")
    }
}

/// The block of `cells` over its width and twice as many over its height, as a mesh file with two regions, a quarter of it
/// stiff.
pub fn mesh(folder: &Path, cells: usize) {
    let side = evenly(0.0, 0.04, cells);
    let mut mesh = block(&side, &side, &evenly(0.0, HEIGHT, 2 * cells));
    mesh.region_names = vec!["soft".into(), "stiff".into()];
    let centre = |t: &[u32; 4]| t.iter().map(|&n| mesh.nodes[n as usize]).sum::<Vector3<f64>>() / 4.0;
    mesh.regions = mesh.tetrahedra.iter().map(|t| u16::from(centre(t).x < 0.02 && centre(t).y < 0.02)).collect();
    write_msh(folder.join("block.msh"), &mesh).unwrap();
}

/// The block on the mesh of the folder, its stiff quarter `ratio` times as stiff; the reason where a law has no such element.
pub fn world(folder: &Path, law: &str, element: ElementKind, ratio: f64, guard: bool) -> Result<World, String> {
    let text = format!(
        r#"
        name = "ordeal"
        [[body]]
        name = "block"
        mesh = "block.msh"
        density = 1000
        rayleigh_mass = 2.0
        rayleigh_stiffness = 0.01
        material = {{ law = "neo_hookean", young = 5e3, poisson = 0.4 }}
        # Rounding decides where a wound-up body rests: the table of the ordeals is of these methods.
        compliance = "async"
        fixed = [{{ below = {{ axis = "z", at = 1e-9 }} }}, {{ above = {{ axis = "z", at = {top} }} }}]
        [[tool]]
        name = "far away"
        shape = {{ kind = "sphere", radius = 0.005 }}
        [hand]
        path = [{{ time = 0, position = [1, 1, 1] }}]
        "#,
        top = HEIGHT - 1e-9
    );
    let mut scene = Scene::from_toml(&text, folder).expect("a sound scene");
    let of = |young| Material::from_young_poisson(law, young, 0.4).expect("a registered law");
    scene
        .edit(|d| {
            (d.bodies[0].material, d.bodies[0].guard) = (of(5e3).into(), guard);
            d.bodies[0].element = element;
            d.bodies[0].regions.insert("stiff".into(), of(5e3 * ratio).into());
        })
        .expect("a sound change");
    scene.build().map_err(|e| e.to_string())
}

/// Volume ratio of each linear tetrahedron of the mesh at `q`; of other elements none.
fn volume_ratios_at(world: &World, q: &[Vector3<f64>]) -> HashMap<usize, f64> {
    if world.model().element_kind() != ElementKind::Linear {
        return HashMap::new();
    }
    let (model, ratio) = (world.model(), |e: &Tetrahedron| e.deformation_gradient(q).determinant());
    model.mesh_tetrahedron().iter().map(|&t| t as usize).zip(model.elements().iter().map(ratio)).collect()
}

/// One step of the simulation; counts where it fails, and holds it to its promises.
fn step(simulation: &mut Simulation<'_>, outcome: &mut Outcome) {
    let report = simulation.step(&Isometry3::translation(1.0, 1.0, 1.0));
    assert!(simulation.positions().iter().all(|q| q.iter().all(|x| x.is_finite())), "{report:?}");
    outcome.inverted = report.assembly.inverted;
    outcome.held_open = report.folds.folded;
    outcome.tangled = report.tangle.map_or(0, |tangle| tangle.edges);
    outcome.led += u32::from(report.led);
    let troubled = report.tangle.is_some() || report.assembly.inverted > 0 || report.folds.folded > 0;
    outcome.named = if troubled { outcome.named + 1 } else { 0 };
    if let Some(tangle) = report.tangle {
        assert!(tangle.edges > 0 && tangle.winding != 1, "{tangle:?}");
        assert_eq!(tangle.place.region, simulation.world().mesh().regions[tangle.place.tetrahedron as usize]);
    }
    outcome.steps_inverted += u32::from(report.assembly.inverted > 0);
    outcome.repeated += u32::from(report.repeated > 0);
    if report.assembly.inverted > 0 {
        assert!(report.assembly.min_jacobian <= 0.0);
        let worst = report.assembly.min_jacobian_tetrahedron as usize;
        assert!(worst < simulation.world().mesh().tetrahedra.len(), "the worst of the inverted elements is named");
        let ratios = volume_ratios_at(simulation.world(), simulation.state().before());
        assert!(ratios.get(&worst).is_none_or(|j| (j - report.assembly.min_jacobian).abs() <= 1e-9 * j.abs()));
    }
    outcome.smallest = outcome.smallest.min(report.assembly.min_jacobian);
    if report.status == StepStatus::RolledBack {
        outcome.rolled_back += 1;
        let failed = report.failed.expect("an element is named");
        let mesh = simulation.world().mesh();
        assert_eq!(failed.region, mesh.regions[failed.tetrahedron as usize]);
        assert!(simulation.state().fem.v.iter().all(|v| *v == Vector3::zeros()), "at rest");
    }
}

pub fn endure(world: &World, ordeal: Ordeal) -> Outcome {
    let mut simulation = Simulation::new(world).expect("positive definite at rest");
    let rest = world.mesh().nodes.clone();
    let top: Vec<usize> = (0..rest.len()).filter(|&i| rest[i].z > HEIGHT - 1e-9).collect();
    let mut outcome = Outcome { smallest: f64::INFINITY, ..Outcome::default() };
    for &node in world.model().node_of_free() {
        simulation.state_mut().fem.q[node as usize] = ordeal.begun(rest[node as usize]);
    }
    for k in 1..=STEPS.iter().sum() {
        for &i in &top {
            simulation.state_mut().fem.q[i] = ordeal.driven(rest[i], share(k));
        }
        step(&mut simulation, &mut outcome);
    }
    outcome.astray = simulation.positions().iter().zip(&rest).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max) / HEIGHT;
    let model = world.model();
    let state = &simulation.state().fem;
    let speeds = model.node_of_free().iter().map(|&n| state.v[n as usize].norm());
    outcome.speed = speeds.fold(0.0, f64::max) / HEIGHT;
    let mut ws = FemWorkspace::new(model);
    outcome.residual = residual(model, state, &mut ws);
    if outcome.held_open > 0 {
        // Held open by a barrier of one of the stiffnesses that it may have.
        ws.folds.find(model, &state.q);
        for growths in 0..8 {
            ws.folds.stiffen(4.0_f64.powi(growths));
            outcome.residual = outcome.residual.min(residual(model, state, &mut ws));
        }
    }
    outcome
}

/// Forces on the free nodes relative to those within the body.
fn residual(model: &FemModel, state: &FemState, ws: &mut FemWorkspace) -> f64 {
    internal_forces(model, state, ws);
    let square = |nodes: &mut dyn Iterator<Item = usize>| -> f64 {
        nodes.map(|n| (ws.f_int[n] + model.gravity() * model.mass()[n]).norm_squared()).sum()
    };
    let free = square(&mut model.node_of_free().iter().map(|&n| n as usize));
    (free / square(&mut (0..model.nodes()))).sqrt()
}
