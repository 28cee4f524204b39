//! Times block Gauss-Seidel on frictional contacts of a sphere with an elastic half-space: one sweep, a cold solve, and a
//! warm solve after the sphere moved as far as a hand moves it in a millisecond.
//!
//! `cargo run --release -p palpate-solver --example sweep_timing`
#![allow(clippy::print_stdout)]

#[path = "../tests/half_space/mod.rs"]
mod half_space;

use palpate_solver::gauss_seidel::{self, GaussSeidelConfig, GaussSeidelWorkspace};
use std::hint::black_box;
use std::time::Instant;

const FRICTION: f64 = 0.5;

/// Best of several runs, in microseconds: the machine may be busy.
fn best_of(runs: usize, mut run: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64() * 1e6
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    println!(
        "{:>8} {:>6} {:>9} {:>10} {:>9} {:>20} {:>20} {:>20}",
        "contacts",
        "closed",
        "sweep us",
        "prepare us",
        "check us",
        "cold 1e-3 (n, us)",
        "cold 1e-6 (n, us)",
        "warm 1e-3 (n, us)"
    );
    // Most contacts sliding and a quarter open, then all closed and most sticking.
    let cases = [2e-3, 8e-3].into_iter().flat_map(|depth| [10, 30, 60, 150].map(|contacts| (contacts, depth)));
    for (contacts, depth) in cases {
        let problem = half_space::pressed_sphere(contacts, FRICTION, depth, 1.5e-3);
        let next = half_space::pressed_sphere(contacts, FRICTION, depth + 2e-5, 1.55e-3);
        let view = problem.view();
        let mut ws = GaussSeidelWorkspace::with_capacity(problem.rows());
        let mut lambda = vec![0.0; problem.rows()];
        let scale = palpate_solver::residual::scale(&view).unwrap_or(1.0);

        // Sweeps away from the solution, so that local problems are as hard as they come.
        let sweeps: u32 = 20;
        let sweep = best_of(50, || {
            lambda.fill(0.0);
            let _ = gauss_seidel::prepare(&view, &mut lambda, &mut ws);
            for _ in 0..sweeps {
                gauss_seidel::sweep(&view, &mut lambda, 1.0, false, &mut ws);
            }
        });
        let empty = best_of(50, || {
            lambda.fill(0.0);
            let _ = gauss_seidel::prepare(&view, &mut lambda, &mut ws);
        });
        let sweep = (sweep - empty) / f64::from(sweeps);

        let mut solve = |tolerance: f64, warm: bool| {
            let config = GaussSeidelConfig { tolerance, max_sweeps: 20_000, ..Default::default() };
            let mut start = vec![0.0; problem.rows()];
            if warm {
                gauss_seidel::solve(&view, &mut start, &GaussSeidelConfig { tolerance: 1e-4, ..config }, &mut ws);
            }
            let mut report = None;
            let view = if warm { next.view() } else { view };
            let time = best_of(30, || {
                lambda.copy_from_slice(&start);
                report = Some(gauss_seidel::solve(&view, &mut lambda, &config, &mut ws));
            });
            report.map_or_else(String::new, |r| format!("{} {time:.1} {:.0e}", r.iterations, r.residual))
        };
        let (cold3, cold6, warm) = (solve(1e-3, false), solve(1e-6, false), solve(1e-3, true));
        let closed = lambda.iter().step_by(3).filter(|normal| **normal > 0.0).count();
        let _ = gauss_seidel::prepare(&view, &mut lambda, &mut ws);
        let prepare = best_of(50, || {
            let _ = gauss_seidel::prepare(&view, &mut lambda, &mut ws);
        });
        let check = best_of(50, || {
            black_box(gauss_seidel::residual(&view, &lambda, scale, &ws));
        });
        println!(
            "{contacts:>8} {closed:>6} {sweep:>9.2} {prepare:>10.2} {check:>9.2} {cold3:>20} {cold6:>20} {warm:>20}"
        );
    }
}
