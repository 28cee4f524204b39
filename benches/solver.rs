//! Block Gauss-Seidel on the contact problem of a ball in the liver with 10, 30 and 60 frictional contacts: cold, and
//! warm from the forces of a tick before.

#![allow(clippy::print_stdout)]

use criterion::Criterion;
use palpate::solver::gauss_seidel::{GaussSeidelConfig, GaussSeidelWorkspace, solve};

mod organ;
use organ::patch::Patch;
use organ::{CELLS, benches, liver_under_ball, press};

/// How far (m) a hand that moves at 20 mm/s presses on in one millisecond.
const TICK_MOTION: f64 = 20e-6;

fn measure(c: &mut Criterion, patch: &Patch) {
    let view = patch.problem.view();
    let rows = view.rows();
    let mut ws = GaussSeidelWorkspace::with_capacity(rows);
    let config = |tolerance| GaussSeidelConfig { tolerance, max_sweeps: 20_000, ..GaussSeidelConfig::default() };

    // The problem of the tick before: every contact a tick's motion farther out.
    let mut delta_before = view.delta_free.to_vec();
    view.blocks.iter().for_each(|block| delta_before[block.start] += TICK_MOTION);
    let before = palpate::solver::problem::ProblemView { delta_free: &delta_before, ..view };
    let mut lambda_before = vec![0.0; rows];
    solve(&before, &mut lambda_before, &config(1e-9), &mut ws);

    let mut group = c.benchmark_group(format!("solver, {} contacts", view.blocks.len()));
    let zero = vec![0.0; rows];
    let mut lambda = vec![0.0; rows];
    for (case, start, tolerance) in
        [("cold to 1e-3", &zero, 1e-3), ("cold to 1e-6", &zero, 1e-6), ("warm to 1e-3", &lambda_before, 1e-3)]
    {
        let config = config(tolerance);
        let mut once = || {
            lambda.copy_from_slice(start);
            solve(&view, &mut lambda, &config, &mut ws)
        };
        let done = once();
        println!(
            "{} contacts, {} carry force, {case}: {:?} after {} sweeps",
            view.blocks.len(),
            patch.active,
            done.status,
            done.iterations
        );
        group.bench_function(case, |b| b.iter(&mut once));
    }
    group.finish();
}

fn main() {
    benches(1, |c| {
        let world = liver_under_ball(CELLS[1]);
        let (simulation, _) = press(&world);
        [10, 30, 60].into_iter().for_each(|contacts| measure(c, &Patch::of(&simulation, contacts)));
    });
}
