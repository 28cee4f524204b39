//! What the tick and the step ask of a solver, in times: a warm solve to 1e-3, a cold one to 1e-8, and the settings of SOFA's
//! solver beside them: no warm start, a fixed number of sweeps.

use std::time::Instant;

use palpate::solver::gauss_seidel::GaussSeidelConfig;
use palpate::solver::problem::ProblemView;
use palpate::solver::residual;
use palpate::solver::solver::Solver;

use super::problems::Named;
use super::profile::ITERATIONS;
use crate::chart::table::{Table, Value};

/// How far (m) a hand that moves at 20 mm/s presses on in one millisecond.
const TICK_MOTION: f64 = 20e-6;

/// Sweeps of SOFA's solver in its examples.
const SOFA_SWEEPS: u32 = 100;

/// Columns of [`row`].
pub(crate) const COLUMNS: [&str; 9] = [
    "problem",
    "contacts",
    "warm to 1e-3, gauss_seidel [µs]",
    "as SOFA: cold, 100 sweeps [µs]",
    "its residual",
    "cold to 1e-8, gauss_seidel [µs]",
    "cold to 1e-8, semismooth_newton [µs]",
    "cold to 1e-8, automatic [µs]",
    "Newton's gain over Gauss-Seidel",
];

/// Median time (s) from the forces in `start`, and the residual (judged from the forces) that it ended with.
fn timed(view: &ProblemView<'_>, solver: Solver, start: &[f64], repetitions: usize) -> (f64, f64) {
    let (mut ws, mut lambda) = (solver.workspace(view.rows()), start.to_vec());
    let mut times: Vec<f64> = (0..repetitions.max(1))
        .map(|_| {
            lambda.copy_from_slice(start);
            let begin = Instant::now();
            solver.solve(view, &mut lambda, &mut ws);
            begin.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let judged = residual::evaluate(view, &lambda, &mut vec![0.0; view.rows()]);
    (times[times.len() / 2], judged.relative)
}

/// Forces of the problem of the tick before: every contact a tick's motion farther out.
fn forces_before(view: &ProblemView<'_>) -> Option<Vec<f64>> {
    let mut delta = view.delta_free.to_vec();
    view.blocks.iter().for_each(|block| delta[block.start] += TICK_MOTION);
    let solver = Solver::from_name("automatic")?.limited(1e-9, None);
    let mut lambda = vec![0.0; view.rows()];
    solver.solve(&ProblemView { delta_free: &delta, ..*view }, &mut lambda, &mut solver.workspace(view.rows()));
    Some(lambda)
}

/// Measures one problem.
pub(crate) fn row(named: &Named, repetitions: usize, table: &mut Table) {
    let view = named.problem.view();
    let (Some(before), zero) = (forces_before(&view), vec![0.0; view.rows()]) else { return };
    let gauss_seidel = GaussSeidelConfig { tolerance: 1e-3, max_sweeps: ITERATIONS, ..GaussSeidelConfig::default() };
    let cold = |name: &str| {
        let solver = Solver::from_name(name)?.limited(1e-8, Some(ITERATIONS));
        let (time, residual) = timed(&view, solver, &zero, repetitions);
        (residual <= 1.001e-8).then_some(time)
    };
    let (warm, _) = timed(&view, gauss_seidel.into(), &before, 20 * repetitions);
    let fixed = GaussSeidelConfig { tolerance: 0.0, max_sweeps: SOFA_SWEEPS, ..GaussSeidelConfig::default() };
    let (sofa, left) = timed(&view, fixed.into(), &zero, repetitions);
    // Nearly all the time it needs: a run that goes on falling is not called stalled.
    let patient = GaussSeidelConfig { tolerance: 1e-8, stall_sweeps: 5000, ..gauss_seidel };
    let (plain, reached) = timed(&view, patient.into(), &zero, repetitions);
    let plain = (reached <= 1.001e-8).then_some(plain);
    let newton = cold("semismooth_newton");
    let micro = |time: Option<f64>| time.map_or(Value::None, |t| Value::Number(1e6 * t, 1));
    table.push(vec![
        named.name.as_str().into(),
        view.blocks.len().into(),
        micro(Some(warm)),
        micro(Some(sofa)),
        Value::Power(left),
        micro(plain),
        micro(newton),
        micro(cold("automatic")),
        plain.zip(newton).map_or(Value::None, |(plain, newton)| Value::Number(plain / newton, 1)),
    ]);
}
