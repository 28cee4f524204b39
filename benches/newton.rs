//! How much sooner Newton solves contact on tissue than sweeps of Gauss-Seidel, on problems that nothing was tuned on: other
//! friction, other ways along, other points and other numbers of contacts than those of `cargo bench --bench solver`.
//!
//! Cold solves to 1e-8, run in turn, medians; the last lines count the problems by their ratio.

#![allow(clippy::print_stdout)]

use palpate::collision::detection::ContactKind;
use palpate::solver::gauss_seidel::GaussSeidelConfig;
use palpate::solver::problem::ConstraintProblem;
use palpate::solver::solver::Solver;
use std::time::Instant;

mod block;
mod organ;
mod slab;
use block::Drag;
use organ::patch::Patch;
use organ::{CELLS, drag, liver_under_ball, measuring, paired_medians, pool, press};
use slab::{Skin, Slab, Tool};

const TOLERANCE: f64 = 1e-8;

/// Sweeps and iterations that a solver may do: [`Tool::Settled`] takes tens of thousands of sweeps, or never gets there.
const MOST: u32 = 50_000;

/// Time (s) of the solves of one problem, more or less.
const PATIENCE: f64 = 0.5;

/// Most repetitions of a pair.
const REPETITIONS: usize = 20;

/// What one pair of solves said.
struct Ratio {
    name: String,
    contacts: usize,
    /// Medians (s) of Gauss-Seidel and of Newton.
    times: [f64; 2],
    solved: [bool; 2],
}

impl Ratio {
    fn of(name: String, problem: &ConstraintProblem) -> Self {
        let sweeps = GaussSeidelConfig {
            tolerance: TOLERANCE,
            max_sweeps: MOST,
            stall_sweeps: 5000,
            ..GaussSeidelConfig::default()
        };
        let newton = Solver::from_name("semismooth_newton").expect("it is registered");
        let solvers = [Solver::from(sweeps), newton.limited(TOLERANCE, Some(MOST))];
        let view = problem.view();
        let mut lambda = vec![0.0; view.rows()];
        let mut memory = solvers.map(|solver| solver.workspace(view.rows()));
        let mut run = |k: usize| {
            lambda.fill(0.0);
            solvers[k].solve(&view, &mut lambda, &mut memory[k]).is_solved()
        };
        let begin = Instant::now();
        let solved = [run(0), run(1)];
        let repetitions = (PATIENCE / begin.elapsed().as_secs_f64()).clamp(1.0, REPETITIONS as f64) as usize;
        let run = std::cell::RefCell::new(run);
        let once = |k: usize| {
            run.borrow_mut()(k);
        };
        let times = paired_medians(if measuring() { repetitions } else { 1 }, || once(0), || once(1));
        Self { name, contacts: view.blocks.len(), times, solved }
    }

    fn print(&self) {
        let star = |k: usize| if self.solved[k] { ' ' } else { '*' };
        println!(
            "  {:<38} {:>4} contacts: sweeps {:>9.1}{} us, Newton {:>9.1}{} us, ratio {:.2}",
            self.name,
            self.contacts,
            1e6 * self.times[0],
            star(0),
            1e6 * self.times[1],
            star(1),
            self.times[0] / self.times[1]
        );
    }
}

/// The problems, by name.
fn problems(sizes: [usize; 3]) -> Vec<(String, ConstraintProblem)> {
    let mut all = Vec::new();
    let world = liver_under_ball(CELLS[2]);
    let (mut simulation, _) = press(&world);
    let of = |simulation: &_, size: usize| Patch::of(simulation, size).problem;
    all.extend([45, 90, 120].map(|size| ("liver, pressed".to_string(), of(&simulation, size))));
    drag(&world, &mut simulation);
    all.extend([45, 90, 120].map(|size| ("liver, dragged".to_string(), of(&simulation, size))));
    for at in [ContactKind::Nodes, ContactKind::Faces] {
        for (friction, along) in [(0.15, 2e-3), (0.3, 5e-4), (0.6, 2e-3)] {
            let name = format!("block, {at:?}, friction {friction}, {} mm", 1e3 * along);
            let set = block::problems(Drag { at, friction, along }, sizes);
            all.extend(set.map(|problem| (name.clone(), problem)));
        }
    }
    let slab = Slab::new();
    for tool in [Tool::Flat, Tool::Round, Tool::Settled] {
        for (friction, seed) in [(0.2, 5), (0.8, 77)] {
            let name = format!("slab, {tool:?}, friction {friction}, seed {seed}");
            all.extend(sizes.map(|size| (name.clone(), slab.problem(size, tool, Skin { friction, seed }))));
        }
    }
    all
}

fn main() {
    pool(1).install(|| {
        let sizes = if measuring() { [60, 100, 150] } else { [10, 12, 15] };
        println!("cold to {TOLERANCE:.0e}, Gauss-Seidel and Newton (a star: not reached):");
        let ratios: Vec<Ratio> = problems(sizes).into_iter().map(|(name, problem)| Ratio::of(name, &problem)).collect();
        ratios.iter().for_each(Ratio::print);
        let mut values: Vec<f64> = (ratios.iter().filter(|ratio| ratio.solved == [true; 2]))
            .map(|ratio| ratio.times[0] / ratio.times[1])
            .collect();
        values.sort_by(f64::total_cmp);
        let below = values.iter().filter(|ratio| **ratio < 3.0).count();
        let (least, most) = (values.first().unwrap_or(&f64::NAN), values.last().unwrap_or(&f64::NAN));
        println!(
            "both reach it on {} of {} problems: ratio {least:.2} to {most:.1}, below 3 on {below}",
            values.len(),
            ratios.len()
        );
        let alone = |solved: [bool; 2]| ratios.iter().filter(|ratio| ratio.solved == solved).count();
        println!("Newton alone reaches it on {}, sweeps alone on {}", alone([false, true]), alone([true, false]));
    });
}
