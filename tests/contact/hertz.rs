//! A rigid sphere on a large block against Hertz (1882): `F = 4/3 E* sqrt(R) d^(3/2)`, `E* = E / (1 - nu²)`.

#![allow(clippy::print_stdout)] // tables of what was measured

use crate::quasi_static::press;
use nalgebra::Vector3;
use palpate::fem::block::block;
use palpate::fem::format::write_vtu;
use palpate::prelude::*;

const RADIUS: f64 = 0.1;
const YOUNG: f64 = 10e3;
const POISSON: f64 = 0.3;

/// Depths over the sphere's radius.
const DEPTHS: [f64; 3] = [0.0375, 0.06, 0.1];

/// Hertz's force (N) at depth `d` (m).
fn hertz(d: f64) -> f64 {
    4.0 / 3.0 * YOUNG / (1.0 - POISSON * POISSON) * RADIUS.sqrt() * d.powf(1.5)
}

/// Coordinates from 0 to `end` (m): cells of `cell` up to `fine`, then each wider than the one before, by a factor that
/// itself rises: errors far from the contact count less than in proportion.
fn graded(cell: f64, fine: f64, rise: f64, end: f64) -> Vec<f64> {
    let mut at = vec![0.0];
    let (mut x, mut width, mut growth) = (0.0, cell, 1.0);
    while x < end {
        if x + 0.5 * cell > fine {
            growth += rise;
            width *= growth;
        }
        // A last cell is not left thinner than half of its neighbour.
        x = if x + 1.5 * width < end { x + width } else { end };
        at.push(x);
    }
    at
}

/// The same to both sides of 0.
fn mirrored(half: &[f64]) -> Vec<f64> {
    half.iter().rev().map(|x| -x).chain(half[1..].iter().copied()).collect()
}

/// A mesh under the sphere, and its forces.
struct Pressed {
    nodes: usize,
    contacts: usize,
    forces: [f64; 3],
}

/// Presses with cells of `cell` (m) under the sphere, into a block of `wide` (m) to each side and `deep` below.
fn pressed(cell: f64, wide: f64, deep: f64) -> Pressed {
    let contact_radius = RADIUS * DEPTHS[2].sqrt();
    let across = mirrored(&graded(cell, 1.02 * contact_radius, 0.12, wide));
    let down: Vec<f64> = graded(cell, 2.0 * cell, 0.08, deep).iter().rev().map(|z| -z).collect();
    let folder = tempfile::tempdir().unwrap();
    write_vtu(folder.path().join("block.vtu"), &block(&across, &across, &down), &[]).unwrap();
    let text = format!(
        r#"
        name = "hertz"
        [rates]
        step = 0.05
        [[body]]
        name = "block"
        mesh = "block.vtu"
        material = {{ law = "corotational", young = {YOUNG}, poisson = {POISSON} }}
        fixed = [{{ node_set = "z_min" }}]
        compliance = "exact"
        tolerance = 1e-8
        [[tool]]
        name = "ball"
        shape = {{ kind = "sphere", radius = {RADIUS} }}
        [contact]
        at = "nodes"
        max_contacts = 600
        [solver]
        tolerance = 1e-6
        max_sweeps = 20000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.2] }}]
        "#
    );
    let world = Scene::from_toml(&text, folder.path()).unwrap().build().unwrap();
    let mut sim = Simulation::new(&world).unwrap();
    let mut contacts = 0;
    let forces = DEPTHS.map(|depth| {
        // A Newton iteration that changes the force by less than 3 % leaves it within 0.1 % of the equilibrium's.
        let (report, _) = press(&mut sim, Vector3::new(0.0, 0.0, RADIUS * (1.0 - depth)), 0.03);
        contacts = report.active;
        report.force.z
    });
    let result = Pressed { nodes: world.mesh().nodes.len(), contacts, forces };
    print!("{:4.1} mm {:7} {:6}", 1e3 * cell, result.nodes, result.contacts);
    result.forces.iter().zip(result.errors()).for_each(|(f, e)| print!("   {f:.4} N ({:+5.2} %)", 100.0 * e));
    println!("   {:.4}", result.slope());
    result
}

impl Pressed {
    /// Errors against Hertz (relative).
    fn errors(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.forces[k] / hertz(DEPTHS[k] * RADIUS) - 1.0)
    }

    /// Root mean square of the errors: single ones jump as nodes come into contact one ring after the other.
    fn mean_error(&self) -> f64 {
        (self.errors().iter().map(|e| e * e).sum::<f64>() / 3.0).sqrt()
    }

    fn worst(&self) -> f64 {
        self.errors().iter().fold(0.0, |m, e| m.max(e.abs()))
    }

    /// Slope of the least-squares line through (log depth, log force).
    fn slope(&self) -> f64 {
        let (x, y) = (DEPTHS.map(f64::ln), self.forces.map(f64::ln));
        let mean = |v: &[f64; 3]| v.iter().sum::<f64>() / 3.0;
        let (mx, my) = (mean(&x), mean(&y));
        let xy: f64 = x.iter().zip(&y).map(|(x, y)| (x - mx) * (y - my)).sum();
        xy / x.iter().map(|x| (x - mx).powi(2)).sum::<f64>()
    }
}

/// At a tenth of the radius, Hertz's parabola instead of the sphere makes +0.5 % (Sneddon 1965). The block, 10 contact
/// radii to each side and 20 deep, is as stiff as one of 30 each way within 1 %: its free sides and its fixed base shift
/// the force to opposite sides. The rest is the mesh: linear tetrahedra are too stiff, and contact at nodes
/// knows the edge of the contact only to a cell.
#[test]
fn sphere_on_a_block_converges_to_hertz() {
    println!("cell       nodes  contacts  force and error at d / R = {DEPTHS:?}, slope of log force");
    let coarse = pressed(0.016, 1.0, 2.0);
    let middle = pressed(0.0095, 1.0, 2.0);
    let fine = pressed(0.0057, 1.0, 2.0);
    assert!(middle.mean_error() < 0.75 * coarse.mean_error() && fine.mean_error() < 0.75 * middle.mean_error());
    assert!(fine.worst() < 0.05, "{}", fine.worst());
    assert!((fine.slope() - 1.5).abs() < 0.03, "{}", fine.slope());

    println!("a block three times as wide");
    let large = pressed(0.016, 3.0, 3.0);
    for (a, b) in coarse.forces.iter().zip(&large.forces) {
        assert!((a / b - 1.0).abs() < 0.01, "the block is too small: {a} N, {b} N in a larger one");
    }
}
