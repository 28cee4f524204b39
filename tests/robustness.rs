//! Tissue beyond reason at 30 Hz: crushed, pulled, twisted, begun inside out or flat, for every law and for stiffness
//! ratios of 1 and 1e4. Either the body comes back to its shape, or each failed step names an element, puts the body
//! back, and the simulation goes on.
//!
//! `cargo test --release -p palpate --test robustness -- --nocapture` prints the table of `docs/robustness.md`.

#![allow(clippy::print_stdout)] // the table

use std::{collections::HashMap, path::Path};

use nalgebra::{Isometry3, Rotation3, Vector3};
use palpate::fem::assembly::{FemWorkspace, OPEN_BELOW, internal_forces};
use palpate::fem::block::{block, evenly};
use palpate::fem::element::{ElementKind, Tetrahedron};
use palpate::fem::format::write_msh;
use palpate::fem::material::Material;
use palpate::prelude::*;
use palpate::step::StepStatus;

/// Height of the block (m); its base is 4 cm wide.
const HEIGHT: f64 = 0.06;

/// Steps of the driven motion, of holding it, of the way back, and of rest after it.
const STEPS: [u32; 4] = [30, 10, 30, 90];

/// What happens to the block.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Ordeal {
    Crushed,
    Pulled,
    Twisted,
    InsideOut,
    Flat,
}

const ORDEALS: [Ordeal; 5] = [Ordeal::Crushed, Ordeal::Pulled, Ordeal::Twisted, Ordeal::InsideOut, Ordeal::Flat];

impl Ordeal {
    /// Place of a node of the driven end at the share `s` of the motion.
    fn driven(self, x: Vector3<f64>, s: f64) -> Vector3<f64> {
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
    fn begun(self, x: Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::InsideOut => Vector3::new(x.x, x.y, HEIGHT - x.z),
            Self::Flat => Vector3::new(x.x, x.y, 0.5 * HEIGHT),
            _ => x,
        }
    }
}

/// Laws that soften in shear beyond a full turn: see the test.
const WIND_UP: [&str; 4] = ["mooney_rivlin", "arruda_boyce", "veronda_westmann", "ogden"];

/// What became of the block.
#[derive(Clone, Copy, Debug)]
struct Outcome {
    rolled_back: u32,
    inverted: u32,
    /// Largest distance of a node from its place at rest, relative to the height.
    astray: f64,
    smallest: f64,
    /// Largest speed of a node at the end, in heights per second.
    speed: f64,
    /// Forces on the free nodes at the end, relative to those within the body.
    residual: f64,
}

impl Outcome {
    fn recovers(&self) -> bool {
        self.astray < 1e-3
    }

    /// In equilibrium somewhere, uninverted: what is left of the motion after seconds of damping moves a node by less than
    /// a thousandth of the height in a second, and forces are balanced to a thousandth.
    fn rests(&self) -> bool {
        self.inverted == 0 && self.speed < 1e-3 && self.residual < 1e-3
    }

    fn text(&self) -> String {
        let failed =
            if self.rolled_back > 0 { format!(" ({} steps rolled back)", self.rolled_back) } else { String::new() };
        let shape = if self.recovers() {
            "recovers".into()
        } else {
            format!(
                "stays {:.0} % astray, {} inverted, {:.0e} heights/s, residual {:.0e}",
                100.0 * self.astray,
                self.inverted,
                self.speed,
                self.residual
            )
        };
        format!("{shape}{failed}")
    }
}

/// The block as a mesh file with two regions, a quarter of it stiff.
fn mesh(folder: &Path) {
    let mut mesh = block(&evenly(0.0, 0.04, 2), &evenly(0.0, 0.04, 2), &evenly(0.0, HEIGHT, 4));
    mesh.region_names = vec!["soft".into(), "stiff".into()];
    let centre = |t: &[u32; 4]| t.iter().map(|&n| mesh.nodes[n as usize]).sum::<Vector3<f64>>() / 4.0;
    mesh.regions = mesh.tetrahedra.iter().map(|t| u16::from(centre(t).x < 0.02 && centre(t).y < 0.02)).collect();
    write_msh(folder.join("block.msh"), &mesh).unwrap();
}

fn world(folder: &Path, law: &str, element: ElementKind, ratio: f64, guard: bool) -> World {
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
    scene.build().expect("a sound world")
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

fn endure(world: &World, ordeal: Ordeal) -> Outcome {
    let mut simulation = Simulation::new(world).expect("positive definite at rest");
    let rest = world.mesh().nodes.clone();
    let top: Vec<usize> = (0..rest.len()).filter(|&i| rest[i].z > HEIGHT - 1e-9).collect();
    let mut outcome =
        Outcome { rolled_back: 0, inverted: 0, astray: 0.0, smallest: f64::INFINITY, speed: 0.0, residual: 0.0 };
    for &node in world.model().node_of_free() {
        simulation.state_mut().fem.q[node as usize] = ordeal.begun(rest[node as usize]);
    }
    let [out, hold, back, quiet] = STEPS;
    for k in 1..=out + hold + back + quiet {
        let s = (f64::from(k) / f64::from(out)).min(1.0)
            - (f64::from(k.saturating_sub(out + hold)) / f64::from(back)).min(1.0);
        for &i in &top {
            simulation.state_mut().fem.q[i] = ordeal.driven(rest[i], s);
        }
        step(&mut simulation, &mut outcome);
    }
    outcome.astray = simulation.positions().iter().zip(&rest).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max) / HEIGHT;
    let model = world.model();
    let state = &simulation.state().fem;
    let speeds = model.node_of_free().iter().map(|&n| state.v[n as usize].norm());
    outcome.speed = speeds.fold(0.0, f64::max) / HEIGHT;
    let mut ws = FemWorkspace::new(model);
    internal_forces(model, state, &mut ws);
    let square = |nodes: &mut dyn Iterator<Item = usize>| -> f64 {
        nodes.map(|n| (ws.f_int[n] + model.gravity() * model.mass()[n]).norm_squared()).sum()
    };
    let free = square(&mut model.node_of_free().iter().map(|&n| n as usize));
    outcome.residual = (free / square(&mut (0..model.nodes()))).sqrt();
    outcome
}

#[test]
fn every_law_comes_back_or_says_where_it_fails() {
    let folder = tempfile::tempdir().unwrap();
    mesh(folder.path());
    println!("| law | element | ratio | {} |", ORDEALS.map(|o| format!("{o:?}")).join(" | "));
    println!("| --- | --- | --- |{}", " --- |".repeat(ORDEALS.len()));
    let quadratic = ["neo_hookean", "mooney_rivlin", "stable_neo_hookean"].map(|law| (law, ElementKind::Quadratic));
    let others = quadratic.into_iter().chain([("neo_hookean", ElementKind::Averaged)]);
    for (law, element) in Material::NAMES.iter().map(|law| (*law, ElementKind::Linear)).chain(others) {
        for ratio in [1.0, 1e4] {
            let world = world(folder.path(), law, element, ratio, true);
            let outcomes = ORDEALS.map(|ordeal| endure(&world, ordeal));
            println!("| `{law}` | {} | {ratio:e} | {} |", element.name(), outcomes.map(|o| o.text()).join(" | "));
            for (ordeal, outcome) in ORDEALS.into_iter().zip(outcomes) {
                // Wound up by a full turn, tissue goes through itself. The laws of this list have more than one equilibrium
                // between the same two ends then, and rounding decides in which they come to rest: uninverted, not torn.
                let wound = ordeal == Ordeal::Twisted && WIND_UP.contains(&law);
                let may_stay = wound && element == ElementKind::Linear;
                // It slipped through itself by inverted elements, and each such step named the worst of them (see `step`).
                let slipped = outcome.smallest <= 0.0;
                // At rest in another shape, or stuck with an element inside out, which every step's report counts and names.
                let whole = (outcome.rests() || outcome.inverted > 0) && outcome.astray < 1.0;
                let case = format!("{law}, {element:?}, {ratio:e}, {ordeal:?}: {outcome:?}");
                assert!(outcome.recovers() || may_stay && whole && slipped, "{case}");
            }
        }
    }
}

#[test]
fn without_the_guard_a_crushed_body_is_torn_named_rolled_back_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    mesh(folder.path());
    let world = world(folder.path(), "neo_hookean", ElementKind::Linear, 1.0, false);
    // What `step` asserts of every step that fails: finite, at rest, an element and its region named.
    let outcome = endure(&world, Ordeal::Crushed);
    assert!(outcome.rolled_back > 0 && !outcome.recovers(), "{outcome:?}");
    let outcome = endure(&world, Ordeal::Pulled);
    assert!(outcome.rolled_back == 0 && outcome.recovers(), "{outcome:?}");
}

/// Of a quadratic body whose nodes are mirrored, elements are folded: the report counts and names them, their motion is
/// repeated, and once they are open again nothing of that acts any more.
#[test]
fn folds_of_quadratic_elements_are_counted_named_and_opened() {
    let folder = tempfile::tempdir().unwrap();
    mesh(folder.path());
    let world = world(folder.path(), "neo_hookean", ElementKind::Quadratic, 1.0, true);
    let mut simulation = Simulation::new(&world).unwrap();
    let rest = world.mesh().nodes.clone();
    for &node in world.model().node_of_free() {
        simulation.state_mut().fem.q[node as usize] = Ordeal::InsideOut.begun(rest[node as usize]);
    }
    let pose = Isometry3::translation(1.0, 1.0, 1.0);
    let first = simulation.step(&pose);
    assert!(first.folds.folded > 0 && first.folds.min_jacobian < OPEN_BELOW, "{:?}", first.folds);
    assert!((first.folds.tetrahedron as usize) < world.mesh().tetrahedra.len());
    assert!(first.repeated > 1, "{}", first.repeated);
    let reports: Vec<_> = (0..60).map(|_| simulation.step(&pose)).collect();
    let opened = reports.iter().position(|r| r.folds.folded == 0).expect("no element stays folded");
    assert!(reports[opened..].iter().all(|r| r.folds.folded == 0), "an element that was opened folds again");
    let last = reports.last().unwrap();
    assert_eq!((last.repeated, last.cuts), (0, 0));
}
