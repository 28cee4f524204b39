//! Whole steps of SOFA's contact scenes beside SOFA's times, and how wrong they are.
//!
//! SOFA (commit 2a278d8, gcc 12 -O3 -march=native, double) was measured on a two-core machine of the same kind; the times
//! are medians of its published runs. Ours are of one worker thread, by the clock and by the processor time of the process.

#![allow(clippy::print_stdout)]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use cpu_time::ThreadTime;
use nalgebra::Vector3;
use palpate::fem::factor::{Factor, FactorStatus, SolveWorkspace};
use palpate::fem::pcg::{PcgConfig, PcgWorkspace, pcg};
use palpate::fem::preconditioner::FactorPreconditioner;
use palpate::prelude::*;
use palpate::step::StepStatus;
use rayon::ThreadPoolBuilder;

/// A scene that both have.
struct Case {
    scene: &'static str,
    /// Its mesh among SOFA's, of the same nodes and tetrahedra as the block of the scene.
    mesh: &'static str,
    /// Rows and milliseconds a step of SOFA.
    sofa_rows: usize,
    sofa_ms: f64,
    /// Steps before the measured ones: until the contacts rest.
    settle: usize,
    measured: usize,
}

const CASES: [Case; 4] = [
    Case { scene: "box756_floor", mesh: "box756", sofa_rows: 168, sofa_ms: 30.0, settle: 60, measured: 100 },
    Case { scene: "box5k_ball", mesh: "box5k", sofa_rows: 153, sofa_ms: 228.0, settle: 60, measured: 60 },
    Case { scene: "box5k_floor", mesh: "box5k", sofa_rows: 585, sofa_ms: 1845.0, settle: 12, measured: 20 },
    Case { scene: "box20k_floor", mesh: "box20k", sofa_rows: 1440, sofa_ms: 47_000.0, settle: 3, measured: 7 },
];

/// The scene, on SOFA's own mesh where it is there.
fn load(case: &Case) -> (Scene, &'static str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut scene =
        Scene::load(&root.join(format!("examples/scenes/{}.toml", case.scene))).expect("the scene is valid");
    let shared = std::env::var_os("PALPATE_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
    let mesh = shared.join(format!("meshes/{}.msh", case.mesh));
    if !mesh.is_file() {
        return (scene, "generated");
    }
    scene.use_mesh(&mesh, 1.0).expect("the mesh can be read");
    (scene, "SOFA's")
}

/// How wrong a step was.
struct Error {
    /// Largest error of a column of `W`, relative to the largest entry of the column by conjugate gradients to 1e-12.
    compliance: f64,
    /// `‖A (v⁺ - v) - b - h Hᵀ λ‖ / ‖b‖`: how far the step is from its own equations of motion.
    motion: f64,
}

/// What rigid bodies add to `H A⁻¹ Hᵀ`. Balls only: their inertia is the same however they turn.
fn of_rigid(simulation: &Simulation<'_>, row: usize, column: usize) -> f64 {
    let rows = &simulation.workspace().rows().rigid;
    let mut sum = 0.0;
    for (body, a) in rows.row(row) {
        let model = &simulation.world().bodies().rigid[*body as usize].model;
        for (_, b) in rows.row(column).iter().filter(|(other, _)| other == body) {
            sum += a.force.dot(&b.force) / model.mass() + a.torque.dot(&(model.inverse_inertia() * b.torque));
        }
    }
    sum
}

/// The error of the last step, which began with the velocities `before`.
fn error(simulation: &Simulation<'_>, before: &[Vector3<f64>]) -> Error {
    let (world, ws) = (simulation.world(), simulation.workspace());
    let (rows, view, h) = (ws.rows(), ws.problem().view(), world.dt());
    let free = world.model().node_of_free();
    let mut factor = Factor::new(Arc::clone(world.symbolic()));
    assert_eq!(factor.refactor(&ws.fem.system).status, FactorStatus::Ok);
    let mut solve = SolveWorkspace::new(world.symbolic());
    let mut work = PcgWorkspace::new(free.len());
    let config = PcgConfig { relative_tolerance: 1e-12, max_iterations: 100 };
    let mut compliance = 0.0_f64;
    for column in [0, rows.len() / 2 + 1, rows.len() - 1] {
        let mut unit = vec![0.0; rows.len()];
        unit[column] = 1.0;
        let (mut load, mut x) = (vec![0.0; 3 * free.len()], vec![0.0; 3 * free.len()]);
        rows.tissue.add_transposed(&unit, &mut load);
        let mut preconditioner = FactorPreconditioner { factor: &factor, workspace: &mut solve };
        _ = pcg(&ws.fem.system, &load, &mut x, &mut preconditioner, config, &mut work);
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for r in 0..rows.len() {
            let exact = h * h * (rows.tissue.dot(r, &x) + of_rigid(simulation, r, column));
            worst = worst.max((exact - view.column(column)[r]).abs());
            largest = largest.max(exact.abs());
        }
        if largest > 0.0 {
            compliance = compliance.max(worst / largest);
        }
    }
    let mut forces = vec![0.0; 3 * free.len()];
    rows.tissue.add_transposed(simulation.forces(), &mut forces);
    let dv: Vec<f64> = free
        .iter()
        .flat_map(|&n| {
            let dv = simulation.state().fem.v[n as usize] - before[n as usize];
            [dv.x, dv.y, dv.z]
        })
        .collect();
    let mut product = vec![0.0; dv.len()];
    ws.fem.system.multiply(&dv, &mut product);
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let left = norm(&mut product.iter().zip(&ws.fem.rhs).zip(&forces).map(|((a, b), f)| a - b - h * f));
    Error { compliance, motion: left / norm(&mut ws.fem.rhs.iter().copied()) }
}

fn percentile(times: &mut [f64], q: f64) -> f64 {
    times.sort_by(f64::total_cmp);
    times[((times.len() - 1) as f64 * q).round() as usize]
}

fn measure(case: &Case, whole: bool) {
    let (scene, mesh) = load(case);
    let world = scene.build().expect("the scene can be built");
    let mut simulation = Simulation::new(&world).expect("the body has a factor");
    let tool = world.first_pose();
    let (settle, measured) = if whole { (case.settle, case.measured) } else { (1, 1) };
    (0..settle).for_each(|_| _ = simulation.step(&tool));
    let (mut wall, mut cpu, mut sweeps, mut residual) = (Vec::new(), Vec::new(), Vec::new(), 0.0_f64);
    let mut shares = [0.0; 4];
    let mut before = simulation.state().fem.v.clone();
    let mut rows = 0;
    for _ in 0..measured {
        before.copy_from_slice(&simulation.state().fem.v);
        let (clock, processor) = (Instant::now(), ThreadTime::now());
        let report = simulation.step(&tool);
        wall.push(1e3 * clock.elapsed().as_secs_f64());
        cpu.push(1e3 * processor.elapsed().as_secs_f64());
        assert_eq!(report.status, StepStatus::Advanced);
        sweeps.push(f64::from(report.solve.iterations));
        residual = residual.max(report.solve.residual);
        rows = report.rows.rows;
        let t = &report.times;
        for (share, time) in shares.iter_mut().zip([t.free_motion, t.compliance, t.solve, t.correction]) {
            *share += time / t.total / measured as f64;
        }
    }
    let error = error(&simulation, &before);
    println!(
        "{:13} {:9} {:6} {:6} {:5} {:5} | {:8.1} {:8.1} | {:8.1} {:8.1} | {:8.0} {:6.1} | {:4.0} {:4.0} {:4.0} {:4.0} | {:5.0} {:.0e} {:.0e} {:.0e}",
        case.scene,
        mesh,
        world.mesh().nodes.len(),
        world.mesh().tetrahedra.len(),
        rows,
        case.sofa_rows,
        percentile(&mut cpu, 0.5),
        percentile(&mut cpu, 0.99),
        percentile(&mut wall, 0.5),
        percentile(&mut wall, 0.99),
        case.sofa_ms,
        case.sofa_ms / percentile(&mut cpu, 0.5),
        100.0 * shares[0],
        100.0 * shares[1],
        100.0 * shares[2],
        100.0 * shares[3],
        percentile(&mut sweeps, 0.5),
        residual,
        error.compliance,
        error.motion,
    );
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // `cargo test --benches` only sees that all runs.
    let whole = arguments.iter().any(|a| a == "--bench") && !arguments.iter().any(|a| a == "--test");
    let wanted = arguments.iter().find(|a| !a.starts_with("--"));
    let chosen = |case: &&Case| wanted.is_none_or(|name| case.scene.contains(name.as_str()));
    println!(
        "                                          rows       | ours, processor ms  | by the clock, ms    | SOFA, ms  times | share of step %     | median sweeps, worst residual,"
    );
    println!(
        "scene         mesh       nodes  tetra  ours  SOFA |      p50      p99 |      p50      p99 |      p50 faster | free    W solve corr | error of W, residual of motion"
    );
    let pool = ThreadPoolBuilder::new().num_threads(1).build().expect("the system grants a thread");
    // Without the measuring only the small scenes are worth their time.
    let cases = CASES.iter().filter(|case| whole || case.sofa_rows < 200).filter(chosen);
    pool.install(|| cases.for_each(|case| measure(case, whole)));
}
