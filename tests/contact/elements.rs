//! Contact with every kind of element: a ball pressed into a block, against a finer mesh of linear elements.

#![allow(clippy::print_stdout)] // a table of what was measured

use crate::quasi_static::press;
use nalgebra::Vector3;
use palpate::fem::assembly::{FemWorkspace, internal_forces};
use palpate::fem::element::ElementKind;
use palpate::fem::sparse::FIXED;
use palpate::prelude::*;
use palpate::step::StepStatus;

const RADIUS: f64 = 0.03;
const TOP: f64 = 0.04;
const FRICTION: f64 = 0.2;

/// Contact at nodes is with friction, at faces without.
fn friction_at(at: &str) -> f64 {
    if at == "nodes" { FRICTION } else { 0.0 }
}

/// The scene's text with a choice of element, Poisson's ratio, cells and place of contacts.
fn text(element: &str, [nx, nz]: [usize; 2], at: &str) -> String {
    let friction = friction_at(at);
    // Points on faces come to rest where those that carry a force stay contacts.
    let hold = at == "faces";
    format!(
        r#"
        name = "press"
        gravity = [0, 0, 0]
        seconds = 0.1
        [rates]
        step = 0.05
        [[body]]
        name = "block"
        element = "{element}"
        block = {{ min = [0, 0, 0], max = [0.08, 0.08, {TOP}], cells = [{nx}, {nx}, {nz}] }}
        material = {{ law = "neo_hookean", young = 10e3, poisson = 0.3 }}
        fixed = [{{ node_set = "z_min" }}]
        compliance = "exact"
        tolerance = 1e-10
        [[tool]]
        name = "ball"
        shape = {{ kind = "sphere", radius = {RADIUS} }}
        [contact]
        at = "{at}"
        hold = {hold}
        friction = {friction}
        max_contacts = 200
        [solver]
        tolerance = 1e-8
        max_sweeps = 20000
        [hand]
        path = [{{ time = 0, position = [0.04, 0.04, 0.1] }}]
        "#
    )
}

/// Force on the ball (N) at 4 mm, after the checks that hold for every element.
fn force(element: &str, cells: [usize; 2], at: &str) -> f64 {
    let scene = Scene::from_toml(&text(element, cells, at), std::path::Path::new("")).unwrap();
    let world = scene.build().unwrap();
    let mut sim = Simulation::new(&world).unwrap();
    let target = Vector3::new(0.041, 0.039, TOP + RADIUS - 0.004);
    let (report, steps) = press(&mut sim, target, 1e-7);
    assert_eq!(report.status, StepStatus::Advanced);
    assert!(report.active >= 3, "{element} {at}: {report:?}");
    let friction = friction_at(at);
    let rows = if friction > 0.0 { 3 } else { 1 };
    for contact in sim.forces().chunks_exact(rows) {
        assert!(contact[0] >= 0.0, "{element} {at}: pulls with {contact:?} N");
        let along = contact[1..].iter().map(|f| f * f).sum::<f64>().sqrt();
        assert!(along <= friction * contact[0] * (1.0 + 1e-6) + 1e-12, "{element} {at}: {contact:?}");
    }
    // What the ground carries is what the ball exerts: the body is at rest, and weighs nothing here.
    let model = world.model();
    let mut ws = FemWorkspace::new(model);
    internal_forces(model, &sim.state().fem, &mut ws);
    let held = ws.f_int.iter().zip(model.free_of_node()).filter(|(_, free)| **free == FIXED);
    let ground: Vector3<f64> = held.map(|(f, _)| f).sum();
    // The residual of Newton's method is about as large as the last change of the force.
    let open = (ground + report.force).norm() / report.force.norm();
    assert!(open < 1e-6, "{element} {at}: {ground} {}", report.force);
    println!("{element:>9} {at} {cells:?}: {:.4} N, {} contacts, {steps} steps", report.force.z, report.active);
    report.force.z
}

#[test]
fn every_element_agrees_with_a_finer_mesh_of_linear_ones() {
    let fine = force("linear", [16, 8], "nodes");
    for kind in ElementKind::ALL {
        let error = force(kind.name(), [8, 4], "nodes") / fine - 1.0;
        println!("{:>9}: {:+.1} %", kind.name(), 100.0 * error);
        assert!(error.abs() < 0.1, "{}: {error}", kind.name());
    }
}

#[test]
fn contacts_on_faces_push_on_every_element() {
    for kind in ElementKind::ALL {
        assert!(force(kind.name(), [8, 4], "faces") > 0.0, "{}", kind.name());
    }
}
