//! `W` of the step against what a force really does: to the equations of motion, and to the gap itself.

#![allow(clippy::print_stdout)] // tables of what was measured

use nalgebra::{Isometry3, Vector3};
use palpate::constraints::frame::ContactFrame;
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::model::FemState;
use palpate::fem::pcg::{PcgConfig, PcgStatus, PcgWorkspace, pcg};
use palpate::fem::preconditioner::BlockJacobi;
use palpate::prelude::*;

/// A ball that presses with friction into a block, turned a little so that no symmetry hides an error.
fn world(compliance: &str) -> World {
    let text = format!(
        r#"
        name = "compliance"
        [rates]
        step = 50
        [[body]]
        name = "block"
        block = {{ min = [-0.05, -0.05, -0.06], max = [0.05, 0.05, 0], cells = [6, 6, 4] }}
        rayleigh_mass = 0.5
        rayleigh_stiffness = 0.004
        material = {{ law = "neo_hookean", young = 6e3, poisson = 0.45 }}
        fixed = [{{ node_set = "z_min" }}]
        compliance = "{compliance}"
        tolerance = 1e-12
        [[tool]]
        name = "ball"
        shape = {{ kind = "sphere", radius = 0.02 }}
        [contact]
        at = "faces"
        friction = 0.4
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.03] }}]
        "#
    );
    Scene::from_toml(&text, std::path::Path::new("")).unwrap().build().unwrap()
}

/// The ball on its way down and sideways.
fn tool(step: u32) -> Isometry3<f64> {
    let way = f64::from(step);
    Isometry3::new(Vector3::new(0.0031 + 2e-4 * way, 0.0047, 0.02 - 5e-4 * way), Vector3::new(0.01 * way, 0.0, 0.0))
}

/// A run into contact; the state at the begin of the last step.
fn pressed(world: &World) -> (Simulation<'_>, FemState) {
    let mut sim = Simulation::new(world).unwrap();
    let mut before = sim.state().fem.clone();
    for step in 1..=12 {
        before = sim.state().fem.clone();
        let report = sim.step(&tool(step));
        assert!(!report.refused);
    }
    assert!(sim.snapshot().valid && sim.snapshot().rows() >= 9, "{} rows", sim.snapshot().rows());
    (sim, before)
}

/// Free velocities (m/s) at the end of a step from `before` under forces on the nodes, by conjugate gradients without
/// the factor: another way through the same equations.
struct Motion<'w> {
    world: &'w World,
    before: FemState,
    fem: FemWorkspace,
    jacobi: BlockJacobi,
    pcg: PcgWorkspace,
}

impl<'w> Motion<'w> {
    fn new(world: &'w World, before: FemState) -> Self {
        let free = world.model().free_nodes();
        let fem = FemWorkspace::new(world.model());
        Self { world, before, fem, jacobi: BlockJacobi::new(free), pcg: PcgWorkspace::new(free) }
    }

    fn under(&mut self, forces: &[Vector3<f64>]) -> Vec<f64> {
        let model = self.world.model();
        assemble(model, &self.before, self.world.dt(), forces, &mut self.fem);
        assert_eq!(self.jacobi.update(&self.fem.system), 0);
        let mut v = vec![0.0; 3 * model.free_nodes()];
        let config = PcgConfig { relative_tolerance: 1e-13, max_iterations: 2000 };
        let report = pcg(&self.fem.system, &self.fem.rhs, &mut v, &mut self.jacobi, config, &mut self.pcg);
        assert!(report.status == PcgStatus::Converged || report.relative_residual < 1e-12, "{report:?}");
        for (v, &node) in v.chunks_exact_mut(3).zip(model.node_of_free()) {
            (0..3).for_each(|c| v[c] += self.before.v[node as usize][c]);
        }
        v
    }
}

/// Nodal forces (N) of a force `size` on one row, scattered by hand from the contact's nodes and weights.
fn row_force(sim: &Simulation<'_>, row: usize, size: f64) -> Vec<Vector3<f64>> {
    let rows = sim.workspace().rows();
    let block = rows.blocks.iter().find(|b| b.range().contains(&row)).unwrap();
    let contact = sim.state().contacts.contacts[block.contact as usize];
    let direction = ContactFrame::new(contact.normal).directions()[row - block.range().start];
    let mut forces = vec![Vector3::zeros(); sim.world().model().nodes()];
    for (&node, weight) in contact.nodes.iter().zip(contact.weights) {
        forces[node as usize] += direction * (weight * size);
    }
    forces
}

/// `W e_j` is how far the rows open when a newton pulls at row `j`: by the equations of motion, with neither the factor
/// nor the rows' own transpose. Tolerance: the solves
/// stop at 1e-13, of a matrix whose condition is some thousands.
#[test]
fn exact_compliance_is_the_gap_per_force_of_the_equations_of_motion() {
    let world = world("exact");
    let (sim, before) = pressed(&world);
    let mut motion = Motion::new(&world, before);
    let free = motion.under(&[]);
    let (rows, h) = (&sim.workspace().rows().tissue, world.dt());
    let m = sim.snapshot().rows();
    let scale = sim.snapshot().compliance().iter().fold(0.0f64, |s, w| s.max(w.abs()));
    let mut worst = 0.0f64;
    for j in 0..m {
        let pulled = motion.under(&row_force(&sim, j, 1.0));
        let change: Vec<f64> = pulled.iter().zip(&free).map(|(a, b)| h * (a - b)).collect();
        for i in 0..m {
            worst = worst.max((rows.dot(i, &change) - sim.snapshot().compliance()[i + m * j]).abs() / scale);
        }
    }
    println!("{m} rows, largest W {scale:.3e} m/N, worst relative difference {worst:.1e}");
    assert!(worst < 1e-8, "{worst:e}");
}

/// The same against the ball's own distance to the tissue points where contacts were found, by central differences of
/// a millinewton: `H` is the derivative of the gap. They move by some 6 µm, so that the ball's curvature (20 mm) leaves
/// an error of `(6 µm / 20 mm)²`.
#[test]
fn normal_compliance_is_the_derivative_of_the_distance_by_the_force() {
    let world = world("exact");
    let (sim, before) = pressed(&world);
    let mut motion = Motion::new(&world, before.clone());
    let (h, pose) = (world.dt(), tool(12));
    let free = motion.under(&[]);
    // Distance of the row's tissue point where the step began, moved only by what the force does.
    let distance = |v: &[f64], row: usize| {
        let contact = sim.state().contacts.contacts[row / 3];
        let mut point = Vector3::zeros();
        for (&node, weight) in contact.nodes.iter().zip(contact.weights) {
            let k = 3 * world.model().free_of_node()[node as usize] as usize;
            let moved = Vector3::from_fn(|c, _| h * (v[k + c] - free[k + c]));
            point += (before.q[node as usize] + moved) * weight;
        }
        world.tool().signed_distance(&pose, &point)
    };
    let m = sim.snapshot().rows();
    let scale = sim.snapshot().compliance().iter().fold(0.0f64, |s, w| s.max(w.abs()));
    let mut worst = 0.0f64;
    for j in (0..m).step_by(3) {
        let gap = sim.state().contacts.contacts[j / 3].gap;
        assert!((distance(&free, j) - gap).abs() < 1e-12);
        let (pushed, pulled) = (motion.under(&row_force(&sim, j, 1e-3)), motion.under(&row_force(&sim, j, -1e-3)));
        for i in (0..m).step_by(3) {
            let slope = (distance(&pushed, i) - distance(&pulled, i)) / 2e-3;
            worst = worst.max((slope - sim.snapshot().compliance()[i + m * j]).abs() / scale);
        }
    }
    println!("{} contacts, worst difference {worst:.1e} of the largest W", m / 3);
    assert!(worst < 1e-6, "{worst}");
}

/// With a factor one step old the warped compliance differs by what the tissue has bent in a step; with a factor that
/// is never refreshed, by more. Both stay near: that is why a factor may be old.
#[test]
fn compliance_from_an_older_factor_nears_the_exact_one_as_it_is_refreshed() {
    let (exact, asynchronous) = (world("exact"), world("async"));
    let (reference, _) = pressed(&exact);
    let error = |refresh: u64| {
        let mut sim = Simulation::new(&asynchronous).unwrap().refresh_every(refresh);
        // The same body up to the last step, so that rows are the same.
        let (sound, before) = pressed(&exact);
        (1..12).for_each(|step| _ = sim.step(&tool(step)));
        sim.state_mut().fem = before;
        sim.step(&tool(12));
        assert_eq!(sim.snapshot().features(), sound.snapshot().features());
        let (a, b) = (sim.snapshot().compliance(), reference.snapshot().compliance());
        let square = |x: f64| x * x;
        (a.iter().zip(b).map(|(a, b)| square(a - b)).sum::<f64>() / b.iter().map(|b| square(*b)).sum::<f64>()).sqrt()
    };
    let (fresh, old) = (error(1), error(0));
    println!("relative error of W: {fresh:.2e} with a factor one step old, {old:.2e} with that of the rest state");
    assert!(fresh < 0.3 * old && fresh < 0.05 && old < 0.5, "{fresh} {old}");
}
