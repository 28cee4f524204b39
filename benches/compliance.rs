//! `W = h² H A⁻¹ Hᵀ` of 10 and 30 frictional contacts on the liver: half solves over the reach of the rows, against full
//! solves with all columns of `Hᵀ` at once, and gathered from the precomputed inverse between the nodes of the skin.
//!
//! `cargo bench --bench compliance -- threads` prints the half solves alone, on one thread and on two.

#![allow(clippy::print_stdout)]

use criterion::Criterion;
use nalgebra::DMatrix;
use palpate::constraints::surface_inverse::{GatherWorkspace, SurfaceInverse};
use palpate::fem::factor::{Factor, FactorStatus, ReachStatus, ReachWorkspace, SolveWorkspace};
use palpate::fem::nodal_rows::NodalRows;
use palpate::simulation::Simulation;
use palpate::world::World;
use std::sync::Arc;
use std::time::Instant;

mod organ;
use organ::patch::Patch;
use organ::{CELLS, benches, liver_under_ball, measuring, nodes, paired_medians, pool, press};

/// Runs in turn for the printed ratio.
const REPETITIONS: usize = 9;

/// `W` by full solves.
struct Full {
    solve: SolveWorkspace,
    columns: Vec<f64>,
}

impl Full {
    fn compliance(&mut self, factor: &Factor, rows: &NodalRows, scale: f64, w: &mut DMatrix<f64>) {
        self.columns.fill(0.0);
        let n = self.columns.len() / rows.len();
        for (r, column) in self.columns.chunks_exact_mut(n).enumerate() {
            for (node, value) in rows.row(r) {
                (0..3).for_each(|c| column[3 * node as usize + c] += value[c]);
            }
        }
        assert!(factor.solve_columns(&mut self.columns, &mut self.solve).is_ok());
        for (j, column) in self.columns.chunks_exact(n).enumerate() {
            (0..rows.len()).for_each(|i| w[(i, j)] = scale * rows.dot(i, column));
        }
    }
}

fn measure(c: &mut Criterion, world: &World, simulation: &Simulation<'_>, contacts: usize) {
    let patch = Patch::of(simulation, contacts);
    let rows = &patch.rows;
    let m = rows.len();
    let mut factor = Factor::new(Arc::clone(world.symbolic()));
    assert_eq!(factor.refactor(&simulation.workspace().fem.system).status, FactorStatus::Ok);
    let h2 = world.dt() * world.dt();
    let (mut w, mut w_full) = (DMatrix::zeros(m, m), DMatrix::zeros(m, m));
    let mut reach = ReachWorkspace::new(world.symbolic(), m);
    let solve = SolveWorkspace::with_columns(world.symbolic(), m);
    let mut full = Full { solve, columns: vec![0.0; m * world.symbolic().degrees_of_freedom()] };

    let repetitions = if measuring() { REPETITIONS } else { 1 };
    let [by_reach, by_solves] = paired_medians(
        repetitions,
        || assert_eq!(factor.compliance_into(rows, h2, &mut w, &mut reach).rows, m),
        || full.compliance(&factor, rows, h2, &mut w_full),
    );
    println!(
        "{}, {} contacts ({} carry force): reach {:.2} ms, full solves {:.2} ms, ratio {:.1}; they differ by {:.0e}",
        nodes(world),
        patch.contacts(),
        patch.active,
        1e3 * by_reach,
        1e3 * by_solves,
        by_solves / by_reach,
        (&w - &w_full).amax() / w_full.amax()
    );

    let begin = Instant::now();
    let surface = SurfaceInverse::new(&factor, &world.free_skin(), usize::MAX).expect("the factor is valid");
    let set_up = begin.elapsed().as_secs_f64();
    let mut gather = GatherWorkspace::new(&surface, m);
    let mut w_gathered = DMatrix::zeros(m, m);
    let [gathered, by_reach] = paired_medians(
        repetitions,
        || assert!(surface.gather_into(rows, h2, w_gathered.as_view_mut(), &mut gather)),
        || assert_eq!(factor.compliance_into(rows, h2, &mut w, &mut reach).rows, m),
    );
    println!(
        "  gathered {:.0} µs, reach {:.2} ms, ratio {:.0}; they differ by {:.0e}; {} nodes of the skin, {:.1} MB, {:.2} s \
         at set-up",
        1e6 * gathered,
        1e3 * by_reach,
        by_reach / gathered,
        (&w - &w_gathered).amax() / w.amax(),
        surface.nodes(),
        1e-6 * SurfaceInverse::bytes(surface.nodes()) as f64,
        set_up
    );

    let mut group = c.benchmark_group(format!("compliance, {}", nodes(world)));
    let contacts = patch.contacts();
    group.bench_function(format!("{contacts} contacts, reach"), |b| {
        b.iter(|| factor.compliance_into(rows, h2, &mut w, &mut reach));
    });
    group.bench_function(format!("{contacts} contacts, full solves"), |b| {
        b.iter(|| full.compliance(&factor, rows, h2, &mut w_full));
    });
    group.bench_function(format!("{contacts} contacts, gathered"), |b| {
        b.iter(|| surface.gather_into(rows, h2, w_gathered.as_view_mut(), &mut gather));
    });
    group.finish();
}

/// Half solves on one thread and on two, in turn: 60 rows are one block, within which two threads share the large fronts.
fn on_two_threads(cell: f64) {
    let world = liver_under_ball(cell);
    let threads = [pool(1), pool(2)];
    let (simulation, _) = threads[1].install(|| press(&world));
    let mut factor = Factor::new(Arc::clone(world.symbolic()));
    assert_eq!(factor.refactor(&simulation.workspace().fem.system).status, FactorStatus::Ok);
    for contacts in [20, 30, 50, 150] {
        let rows = Patch::of(&simulation, contacts).rows;
        let mut reach = ReachWorkspace::new(world.symbolic(), rows.len());
        let mut least = [f64::INFINITY; 2];
        for _ in 0..if measuring() { 5 * REPETITIONS } else { 1 } {
            for (least, pool) in least.iter_mut().zip(&threads) {
                *least = least.min(pool.install(|| {
                    let begin = Instant::now();
                    assert_eq!(factor.half_solve(&rows, &mut reach).status, ReachStatus::Ok);
                    1e3 * begin.elapsed().as_secs_f64()
                }));
            }
        }
        println!(
            "{}, half solves of {} rows: {:.2} ms on one thread, {:.2} on two, ratio {:.2} (least times)",
            nodes(&world),
            rows.len(),
            least[0],
            least[1],
            least[0] / least[1]
        );
    }
}

fn main() {
    if std::env::args().any(|argument| argument == "threads") {
        let cells = if measuring() { &CELLS[1..] } else { &CELLS[..1] };
        cells.iter().for_each(|&cell| on_two_threads(cell));
        return;
    }
    // One worker: this stage of the step is sequential.
    benches(1, |c| {
        for cell in &CELLS[..2] {
            let world = liver_under_ball(*cell);
            let (simulation, _) = press(&world);
            [10, 30].into_iter().for_each(|contacts| measure(c, &world, &simulation, contacts));
        }
    });
}
