//! Equilibria through the whole engine: steps so long that inertia is nothing, repeated with the tool at rest.

#![allow(clippy::print_stdout)] // why a test was skipped

use std::path::PathBuf;

use nalgebra::{Isometry3, Vector3};
use palpate::prelude::*;
use palpate::solver::report::SolveStatus;
use palpate::step::{StepReport, StepStatus};

/// Most steps for one pose of the tool.
const MOST_STEPS: usize = 60;

/// Steps with the tool held at `position` until its force changes by less than `tolerance` (relative) from one step to
/// the next; returns the last report and the number of steps.
///
/// A step of many seconds is one iteration of Newton's method, so the change is also about the error that is left.
pub(crate) fn press(sim: &mut Simulation<'_>, position: Vector3<f64>, tolerance: f64) -> (StepReport, usize) {
    let tool = Isometry3::from(position);
    let mut before = Vector3::repeat(f64::INFINITY);
    for steps in 1..=MOST_STEPS {
        let report = sim.step(&tool);
        assert_eq!(report.status, StepStatus::Advanced);
        assert!(!report.refused && report.detection.dropped == 0, "{report:?}");
        assert_eq!(report.solve.status, SolveStatus::Solved, "{report:?}");
        assert_eq!((report.repeated, report.folds.folded), (0, 0), "the guard has no part in an ordinary press");
        assert!(report.tangle.is_none() && !report.led, "an ordinary press ties no knots");
        if (report.force - before).norm() < tolerance * report.force.norm() {
            return (report, steps);
        }
        before = report.force;
    }
    panic!("no equilibrium at {position:?} within {MOST_STEPS} steps; last force {before:?} N");
}

/// The folder of reference data, or none with the reason printed.
pub(crate) fn reference(file: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("PALPATE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared")), PathBuf::from);
    let path = shared.join(file);
    if path.is_file() {
        return Some(path);
    }
    println!("skipped: there is no {}; PALPATE_SHARED names the folder of reference data", path.display());
    None
}
