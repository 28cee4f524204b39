//! Runs the scene that a trace carries again and compares every force, bit for bit.
//!
//! A lockstep run is a function of its scene. A run in real time also depends on the moment at which each thread read
//! what another had published; the records say which value it was, and the same calculations are done in an order that
//! gives every one the values that it had.

#[cfg(test)]
mod interrupted;
mod recorded;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use palpate_trace::{Trace, TraceError};

use crate::engine::workers;
use crate::record::{END, LOCKSTEP, SCENE, TICKS};
use crate::run::{Length, Observer, RunError, RunOptions, run};
use crate::scene::{Scene, SceneError};
use crate::step::{StepReport, digest};
use crate::summary::RunEnd;
use crate::tick::TickReport;
use recorded::Reached;

/// What a comparison found.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayReport {
    /// Ticks of the trace that were compared.
    pub ticks: usize,
    /// Ticks of the new run that the trace does not hold, or the other way round.
    pub unmatched: usize,
    /// The first tick whose force, torque, tool pose or jaws differ in any bit.
    pub first_difference: Option<u64>,
    /// Largest difference of a force (N).
    pub largest_difference: f64,
    /// The first step after which a rigid body was elsewhere, by any bit.
    pub first_body_difference: Option<u64>,
    /// Ticks that were not compared: their records, or those of their steps, lie in a damaged part of the trace.
    pub lost: usize,
    /// Ticks of the trace that were not reached, where the replay was asked to end.
    pub unreached: Option<usize>,
    /// What is wrong with the trace: it ends early, as after a run that was killed, or parts of it are damaged.
    pub damage: Option<String>,
}

impl ReplayReport {
    /// True where every tick that the trace holds has the same bits.
    pub fn is_identical(&self) -> bool {
        self.unmatched == 0 && self.first_difference.is_none() && self.first_body_difference.is_none()
    }
}

/// Why a trace cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The trace cannot be read.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// It carries no scene.
    #[error("{path}: the trace carries no scene; only traces written by `palpate run` can be replayed", path = path.display())]
    NoScene {
        /// The trace.
        path: PathBuf,
    },
    /// It was recorded against the real clock, and not every record is there.
    #[error(
        "{path}: recorded in real time, and records that a replay needs were dropped or cut off; record again with less \
         load, or with `palpate run SCENE --lockstep`, which drops nothing",
        path = path.display()
    )]
    RealTime {
        /// The trace.
        path: PathBuf,
    },
    /// The body was changed from outside, and how is not in the trace or cannot be read.
    #[error(
        "{path}: the body was changed from outside before step {step}, and the record of how is missing or damaged; replay \
         the trace as it was written",
        path = path.display()
    )]
    MissingChanges {
        /// The trace.
        path: PathBuf,
        /// The first step with the changed body.
        step: u64,
    },
    /// Its scene cannot be built.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Its scene cannot be run.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// Runs the scene of a trace again, as far as the trace goes.
///
/// # Errors
/// An unreadable trace, one without a scene or any tick, or one recorded in real time that lacks records or
/// changes from outside.
pub fn replay(path: &Path) -> Result<ReplayReport, ReplayError> {
    replay_until(path, &AtomicBool::new(false))
}

/// The same until `stop` is set: the ticks up to there are compared.
///
/// # Errors
/// As [`replay`].
pub fn replay_until(path: &Path, stop: &AtomicBool) -> Result<ReplayReport, ReplayError> {
    let (trace, damage) = Trace::recover(path)?;
    let lossy = matches!(damage, Some(TraceError::Parts { .. }));
    let damage = match damage {
        Some(damage) if trace.ticks.is_empty() || trace.attachment(SCENE).is_none() => return Err(damage.into()),
        damage => damage.map(|damage| damage.to_string()),
    };
    let engine = trace.metadata.get("engine").cloned().unwrap_or_default();
    let entry = |key: &str| engine.get(key).map(String::as_str).unwrap_or_default();
    let text = trace.attachment(SCENE).and_then(|bytes| std::str::from_utf8(bytes).ok());
    let (Some(text), Ok(seconds)) = (text, entry("seconds").parse::<f64>()) else {
        return Err(ReplayError::NoScene { path: path.into() });
    };
    let scene = Scene::from_trace(text, entry("embedded") == "true", Path::new(entry("folder")))?;
    let world = scene.build()?;
    let mut comparison = Comparison::new(&trace, lossy);
    if entry("mode") != LOCKSTEP {
        let path = || path.to_path_buf();
        return match workers(None)?.install(|| recorded::again(&world, &trace, stop, &mut comparison))? {
            Reached::End => Ok(ReplayReport { damage, ..comparison.report() }),
            Reached::Stop => Ok(ReplayReport { damage, ..comparison.ended_early() }),
            // Nothing can be followed beyond a record that is lost.
            Reached::MissingRecord if lossy && comparison.next > 0 => {
                comparison.leave_out_the_rest();
                Ok(ReplayReport { damage, ..comparison.report() })
            }
            Reached::MissingRecord => Err(ReplayError::RealTime { path: path() }),
            Reached::MissingChange { step } => Err(ReplayError::MissingChanges { path: path(), step }),
        };
    }
    // A run that was interrupted or killed is as long as it came.
    let ended = trace.metadata.get(END).and_then(|end| end.get(TICKS)?.parse::<u64>().ok());
    let ended = ended.or_else(|| trace.ticks.last().filter(|_| damage.is_some()).map(|last| last.tick + 1));
    let seconds = ended.map_or(seconds, |ticks| ticks as f64 / scene.description().rates.tick);
    let options = RunOptions { length: Length::Seconds(seconds), lockstep: true, ..RunOptions::default() };
    let outcome = run(&world, &options, stop, &mut comparison)?;
    let report = match outcome.summary.end {
        RunEnd::Interrupted => comparison.ended_early(),
        RunEnd::Completed | RunEnd::BodyFailed => comparison.report(),
    };
    Ok(ReplayReport { damage, ..report })
}

struct Comparison<'a> {
    recorded: &'a [palpate_trace::TickRecord],
    next: usize,
    extra: usize,
    /// Parts of the trace are damaged.
    lossy: bool,
    lost: usize,
    first: Option<u64>,
    largest: f64,
    rigid: &'a [palpate_trace::RigidRecord],
    first_body: Option<u64>,
}

impl<'a> Comparison<'a> {
    fn new(trace: &'a Trace, lossy: bool) -> Self {
        let (recorded, rigid) = (&trace.ticks, &trace.rigid);
        Self { recorded, next: 0, extra: 0, lossy, lost: 0, first: None, largest: 0.0, rigid, first_body: None }
    }

    fn report(&self) -> ReplayReport {
        ReplayReport {
            ticks: self.recorded.len(),
            unmatched: self.extra + (self.recorded.len() - self.next),
            first_difference: self.first,
            largest_difference: self.largest,
            first_body_difference: self.first_body,
            lost: self.lost,
            unreached: None,
            damage: None,
        }
    }

    /// The report of a replay that was asked to end.
    fn ended_early(&mut self) -> ReplayReport {
        let (compared, unreached) = self.recorded.split_at(self.next);
        self.recorded = compared;
        ReplayReport { unreached: Some(unreached.len()), ..self.report() }
    }

    /// The ticks that are left cannot be compared.
    fn leave_out_the_rest(&mut self) {
        let ticks = self.recorded.last().map_or(0, |last| last.tick as usize + 1);
        self.lost += ticks - self.next;
        self.recorded = &self.recorded[..self.next];
    }
}

impl Observer for Comparison<'_> {
    fn step(&mut self, report: &StepReport) {
        // By steps in the file, so what is left always begins with the next.
        let of_step = self.rigid.iter().take_while(|r| r.step <= report.step).count();
        let (records, later) = self.rigid.split_at(of_step);
        self.rigid = later;
        let placed = records.iter().filter(|r| r.step == report.step);
        let recorded = digest(placed.map(|r| (r.position, r.orientation, r.velocity, r.angular_velocity)));
        if !records.is_empty() && recorded != report.bodies.digest {
            self.first_body.get_or_insert(report.step);
        }
    }

    fn tick(&mut self, report: &TickReport) {
        let recorded = self.recorded.get(self.next);
        let Some(recorded) = recorded.filter(|recorded| !self.lossy || recorded.tick == report.record.index) else {
            *(if self.lossy { &mut self.lost } else { &mut self.extra }) += 1;
            return;
        };
        self.next += 1;
        let (wrench, pose, jaws) = (&report.record.wrench, &report.record.tool_pose, &report.record.gripper);
        let force: [f64; 3] = wrench.force.into();
        let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(x, y)| x.to_bits() == y.to_bits());
        let same = same(&force, &recorded.force)
            && same(wrench.torque.as_slice(), &recorded.torque)
            && same(pose.translation.vector.as_slice(), &recorded.tool_position)
            && same(pose.rotation.coords.as_slice(), &recorded.tool_orientation)
            && same(&[jaws.opening, jaws.torque], &[recorded.tool_opening, recorded.gripper_torque]);
        if !same {
            self.first.get_or_insert(recorded.tick);
            let difference = force.iter().zip(&recorded.force).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            self.largest = self.largest.max(difference);
        }
    }
}
