//! Times of factorisation, full solves and compliance by reach on blocks of elastic tissue: medians in milliseconds.
//!
//! `W 30`, `W 90`: rows of 10 and 30 frictional contacts in one patch; `scatter`: 30 contacts all over the top;
//! `ratio 90`: 90 full solves at once against `W 90`; `pcg`: one iteration, which is two products and a solve.
//!
//! `cargo run --release -p palpate-fem --example factor_times [repetitions] [least]`; with `least`, the least times instead, which a
//! busy machine disturbs less. With the environment variable `ONLY`, instead of all that one line per body: `W` of 30 to 1,440
//! rows, scattered and in a patch, factorisations and single solves by faer, in double precision and by the copy in 16 bits. On as many threads as `RAYON_NUM_THREADS` says, or two.
#![allow(clippy::print_stdout)]

use std::sync::Arc;
use std::time::{Duration, Instant};

use cpu_time::ThreadTime;
use nalgebra::DMatrix;
use palpate_fem::factor::{Factor, LeftLookingFactor, ReachWorkspace, SolveWorkspace, SymbolicFactor};
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::ordering::approximate_minimum_degree;
use palpate_fem::pcg::{PcgConfig, PcgWorkspace, pcg};
use palpate_fem::preconditioner::FactorPreconditioner;

#[path = "../tests/factor_bodies/mod.rs"]
mod factor_bodies;
use factor_bodies::{Body, Random};

/// How often to repeat, and which of the sorted times to report.
#[derive(Clone, Copy)]
struct Clock {
    repetitions: usize,
    least: bool,
    /// On one thread, its processor time counts, which a busy machine disturbs less than the wall's.
    alone: bool,
}

impl Clock {
    /// Time of `work` in milliseconds, after one run to warm up.
    fn time(self, mut work: impl FnMut()) -> f64 {
        work();
        let mut times: Vec<f64> = (0..self.repetitions)
            .map(|_| {
                let (wall, cpu) = (Instant::now(), ThreadTime::now());
                work();
                let elapsed: Duration = if self.alone { cpu.elapsed() } else { wall.elapsed() };
                1e3 * elapsed.as_secs_f64()
            })
            .collect();
        times.sort_by(f64::total_cmp);
        times[if self.least { 0 } else { times.len() / 2 }]
    }
}

fn main() {
    let threads = std::env::var("RAYON_NUM_THREADS").ok().and_then(|n| n.parse().ok()).unwrap_or(2);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(|| run(threads == 1));
}

fn run(alone: bool) {
    let argument = |k: usize| std::env::args().nth(k);
    let repetitions = argument(1).and_then(|n| n.parse().ok()).unwrap_or(9).max(1);
    let clock = Clock { repetitions, least: argument(2).is_some_and(|word| word == "least"), alone };
    println!(
        "{:>14} {:>6} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7} {:>8} {:>8} {:>8} {:>8}",
        "body",
        "nodes",
        "nnz L",
        "nnz AMD",
        "analyse",
        "faer",
        "factor",
        "Gflop/s",
        "solve 1",
        "30",
        "90",
        "W 30",
        "W 90",
        "scatter",
        "ratio 90",
        "correct",
        "pcg"
    );
    for (name, cells) in [
        ("cube", [9, 9, 10]),
        ("slab", [19, 15, 3]),
        ("cube", [13, 13, 15]),
        ("slab", [23, 19, 6]),
        ("slab", [23, 19, 9]),
        ("cube", [19, 19, 20]),
        ("slab", [44, 35, 5]),
    ] {
        let body = Body::block(cells, 1);
        let n = body.free_nodes();
        let start = Instant::now();
        let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).expect("the block is free"));
        let analyse = 1e3 * start.elapsed().as_secs_f64();
        let amd = SymbolicFactor::with_ordering(&body.pattern, approximate_minimum_degree(&body.pattern))
            .expect("the block is free");
        let a = body.system(2);
        let mut factor = Factor::new(symbolic.clone());
        let factorisation = clock.time(|| {
            factor.refactor(&a);
        });

        let mut yardstick = LeftLookingFactor::new(symbolic.clone(), &a).expect("the pattern is that of the body");
        let left_looking = clock.time(|| {
            yardstick.refactor(&a);
        });

        let mut random = Random(3);
        if std::env::var("ONLY").is_ok() {
            for contacts in [10, 30, 100, 480] {
                let rows = body.scattered_contact_rows(contacts, 4);
                let near = body.contact_rows(contacts, 4);
                let mut ws = ReachWorkspace::new(&symbolic, 3 * contacts);
                let mut w = DMatrix::zeros(3 * contacts, 3 * contacts);
                let t = clock.time(|| {
                    let _ = factor.compliance_into(&rows, 1.0, &mut w, &mut ws);
                });
                let t_near = clock.time(|| {
                    let _ = factor.compliance_into(&near, 1.0, &mut w, &mut ws);
                });
                print!("W {}: {t:.2} {t_near:.2}  ", 3 * contacts);
            }
            let mut ws = SolveWorkspace::with_columns(&symbolic, 2);
            let mut x = random.vector(3 * n);
            let double = clock.time(|| {
                let _ = factor.solve(&mut x, &mut ws);
            });
            let mut rounded = Factor::with_packed_copy(symbolic.clone());
            rounded.refactor(&a);
            let short = clock.time(|| {
                let _ = rounded.precondition(&mut x, &mut ws);
            });
            let mut y = x.clone();
            let faer = clock.time(|| {
                let _ = factor.solve_columns(&mut y, &mut ws);
            });
            if std::env::var("ONLY").is_ok() {
                println!(
                    "{n} faer {left_looking:.1} own {factorisation:.1} solve: faer {faer:.2} own {double:.2} 16 bits {short:.2}"
                );
                continue;
            }
        }
        let full: Vec<f64> = [1, 30, 90]
            .iter()
            .map(|&columns| {
                let mut workspace = SolveWorkspace::with_columns(&symbolic, columns);
                let mut x = random.vector(3 * n * columns);
                clock.time(|| {
                    let _ = factor.solve_columns(&mut x, &mut workspace);
                })
            })
            .collect();

        let mut workspace = ReachWorkspace::new(&symbolic, 90);
        let mut compliance = |rows: &NodalRows| {
            let mut w = DMatrix::zeros(rows.len(), rows.len());
            clock.time(|| {
                let _ = factor.compliance_into(rows, 1.0, &mut w, &mut workspace);
            })
        };
        let scattered = compliance(&body.scattered_contact_rows(30, 4));
        let reach = [10, 30].map(|contacts| compliance(&body.contact_rows(contacts, 4)));
        let lambda = random.vector(90);
        let mut x = vec![0.0; 3 * n];
        let correct = clock.time(|| {
            let _ = factor.correct(&lambda, &mut x, &mut workspace);
        });

        // one iteration of the conjugate gradients: a product and a solve
        let b = random.vector(3 * n);
        let mut solve = SolveWorkspace::new(&symbolic);
        let mut iteration = PcgWorkspace::new(n);
        let pcg_time = clock.time(|| {
            x.fill(0.0);
            let mut preconditioner = FactorPreconditioner { factor: &factor, workspace: &mut solve };
            pcg(&a, &b, &mut x, &mut preconditioner, PcgConfig::default(), &mut iteration);
        });
        println!(
            "{:>14} {:>6} {:>9} {:>9} {:>8.1} {:>8.1} {:>8.1} {:>8.1} {:>8.2} {:>8.1} {:>8.1} {:>8.2} {:>7.2} {:>8.2} {:>8.1} {:>8.2} {:>8.2}",
            format!("{name} {}", symbolic.supernode_count()),
            n,
            symbolic.nonzeros(),
            amd.nonzeros(),
            analyse,
            left_looking,
            factorisation,
            symbolic.flops() / factorisation * 1e-6,
            full[0],
            full[1],
            full[2],
            reach[0],
            reach[1],
            scattered,
            full[2] / reach[1],
            correct,
            pcg_time,
        );
    }
}
