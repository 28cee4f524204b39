//! Performance profiles [Dolan and Moré 2002]: the share `ρ_s(τ)` of problems that solver `s` solves within `τ` times the time of
//! the fastest. Problems that no solver solves are left out; a problem that is not for a solver counts as not solved by it.

use palpate::scene::SolverDescription;
use palpate::solver::comparison::{SolverRun, run_all};
use palpate::solver::solver::Solver;

use super::problems::Named;
use crate::chart::plot::{Axis, Mark, Panel, Series};
use crate::chart::table::{Table, Value};
use crate::chart::{Settings, Work};

/// Largest `τ` that is drawn.
const FARTHEST: f64 = 1e4;

/// Limit of iterations of every run.
pub(crate) const ITERATIONS: u32 = 20_000;

/// Each problem by each solver at one tolerance: the quickest of some runs.
pub(crate) struct Runs {
    /// Natural-map residual that was asked.
    pub(crate) tolerance: f64,
    /// By problem, then by solver of the register.
    pub(crate) runs: Vec<Vec<SolverRun>>,
}

/// All registered solvers at a tolerance.
pub(crate) fn solvers(tolerance: f64) -> Vec<Solver> {
    let named = Solver::NAMES.iter().filter_map(|name| Solver::from_name(name));
    named.map(|solver| solver.limited(tolerance, Some(ITERATIONS))).collect()
}

/// Whether a run met the tolerance, judged from its forces alone.
pub(crate) fn is_solved(run: &SolverRun, tolerance: f64) -> bool {
    // The judge forms the gap anew: rounding of a residual at the tolerance.
    run.judged <= 1.001 * tolerance
}

/// Runs everything; ends early with the problems so far.
pub(crate) fn run(problems: &[Named], tolerance: f64, settings: &Settings, work: &Work) -> Runs {
    let (repetitions, limit) = if settings.quick { (1, 0.1) } else { (3, 2.0) };
    let mut runs = Vec::new();
    for named in problems {
        if !work.next(&format!("{} to {tolerance:e}", named.name)) {
            break;
        }
        let problem = std::slice::from_ref(&named.problem);
        let mut best = run_all(problem, &solvers(tolerance), Some(limit), 0);
        for (best, solver) in best.iter_mut().zip(solvers(tolerance)) {
            for _ in 1..repetitions {
                // What met the limit of time meets it again.
                if best.seconds >= limit {
                    break;
                }
                for again in run_all(problem, &[solver], Some(limit), 0) {
                    if is_solved(&again, tolerance) && again.seconds < best.seconds {
                        *best = again;
                    }
                }
            }
        }
        runs.push(best);
    }
    Runs { tolerance, runs }
}

impl Runs {
    /// Time of each solver over that of the fastest, for each problem that one of them solves; infinite where not solved.
    fn ratios(&self) -> Vec<Vec<f64>> {
        let mut ratios = Vec::new();
        for runs in &self.runs {
            let times: Vec<f64> = runs
                .iter()
                .map(|run| if is_solved(run, self.tolerance) { run.seconds } else { f64::INFINITY })
                .collect();
            let fastest = times.iter().copied().fold(f64::INFINITY, f64::min);
            if fastest.is_finite() {
                ratios.push(times.iter().map(|t| t / fastest).collect());
            }
        }
        ratios
    }

    /// The profile of each solver.
    pub(crate) fn panel(&self) -> Panel {
        let ratios = self.ratios();
        let total = ratios.len().max(1) as f64;
        let series = Solver::NAMES.iter().enumerate().map(|(s, name)| {
            let mut taus: Vec<f64> = ratios.iter().map(|r| r[s]).filter(|tau| *tau <= FARTHEST).collect();
            taus.sort_by(f64::total_cmp);
            let mut points = vec![(1.0, 0.0)];
            let mut share = 0.0;
            for (k, &tau) in taus.iter().enumerate() {
                // A stair: the share jumps at each time.
                points.push((tau, share));
                share = (k + 1) as f64 / total;
                points.push((tau, share));
            }
            points.push((FARTHEST, share));
            Series { name: (*name).into(), mark: Mark::Line, points }
        });
        Panel {
            title: format!("{} problems to a residual of {:e}", ratios.len(), self.tolerance),
            x: Axis::log("τ: time over that of the fastest"),
            y: Axis::linear("ρ(τ): share of problems solved"),
            series: series.collect(),
        }
    }

    /// Solver by solver: how many problems it solves, how often as the fastest, and its middle ratio.
    pub(crate) fn summary(&self, table: &mut Table) {
        let ratios = self.ratios();
        for (s, name) in Solver::NAMES.iter().enumerate() {
            let mut taus: Vec<f64> = ratios.iter().map(|r| r[s]).filter(|tau| tau.is_finite()).collect();
            taus.sort_by(f64::total_cmp);
            table.push(vec![
                (*name).into(),
                Value::Power(self.tolerance),
                taus.len().into(),
                ratios.len().into(),
                taus.iter().filter(|tau| **tau <= 1.0).count().into(),
                taus.get(taus.len() / 2).map_or(Value::None, |tau| Value::Number(*tau, 1)),
            ]);
        }
    }

    /// Every run as a row.
    pub(crate) fn rows(&self, problems: &[Named], table: &mut Table) {
        for (named, runs) in problems.iter().zip(&self.runs) {
            for run in runs {
                let status = serde_json::to_value(run.report.status).ok();
                table.push(vec![
                    named.name.as_str().into(),
                    named.problem.blocks().len().into(),
                    named.problem.rows().into(),
                    Value::Power(self.tolerance),
                    run.solver.into(),
                    status.as_ref().and_then(|s| s.as_str()).unwrap_or_default().into(),
                    (run.report.iterations as usize).into(),
                    Value::Power(run.judged),
                    Value::Number(1e3 * run.seconds, 4),
                ]);
            }
        }
    }
}

/// Fall of the residual below this part of the last point makes a new point of a curve.
const NOTABLE: f64 = 0.9;

/// The best residual so far against time, by solver.
pub(crate) fn residual_against_time(named: &Named, tolerance: f64, limit: f64) -> Panel {
    let runs = run_all(std::slice::from_ref(&named.problem), &solvers(tolerance), Some(limit), ITERATIONS as usize);
    let curve = |run: &SolverRun| {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for sample in &run.history {
            if points.last().is_none_or(|last| sample.residual < NOTABLE * last.1) {
                points.push((1e3 * sample.seconds, sample.residual));
            }
        }
        // Forces at the end: methods of one iteration have no history.
        points.push((1e3 * run.seconds, run.judged.min(points.last().map_or(f64::INFINITY, |last| last.1))));
        Series { name: run.solver.into(), mark: Mark::Line, points }
    };
    let mut series: Vec<Series> = runs.iter().map(curve).collect();
    let times = || series.iter().flat_map(|s| &s.points).map(|p| p.0).filter(|t| *t > 0.0);
    let ends = [times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max)];
    let tick = SolverDescription::default().tick_tolerance;
    let points = ends.map(|t| (t, tick)).into();
    series.push(Series { name: "tolerance of a tick".into(), mark: Mark::Dashed, points });
    Panel { title: named.name.clone(), x: Axis::log("time [ms]"), y: Axis::log("natural-map residual"), series }
}
