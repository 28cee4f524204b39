//! Palpate: real-time haptic simulation of soft tissue.
//!
//! A scene ([`scene::Scene`]) is built into a [`world::World`] and run ([`run::run`]): on threads against the real
//! clock, or in lockstep in virtual time. Three stages share the work: the step (30 Hz, [`step`]), the factor stage
//! (10 Hz, [`refresh`]) and the tick (1 kHz, [`tick`]). SI units throughout; the force of every output is in newtons.
//!
//! ```no_run
//! use palpate::prelude::*;
//!
//! let scene = Scene::bundled("liver")?;
//! let world = scene.build()?;
//! let options = RunOptions { length: Length::Seconds(2.0), lockstep: true, ..RunOptions::default() };
//! let outcome = run(&world, &options, &AtomicBool::new(false), &mut Unobserved)?;
//! println!("largest force {:.2} N", outcome.summary.largest_force);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(rtsan, feature(sanitize))]

pub mod changes;
pub mod counted;
pub mod devices;
mod drawn;
mod engine;
pub mod export;
mod factor_thread;
mod gathering;
mod lockstep;
mod pace;
mod port_summary;
pub mod problem_files;
mod realtime;
mod record;
pub mod refresh;
mod refresh_report;
pub mod refresh_watch;
pub mod replay;
pub mod run;
pub mod scene;
pub mod session;
pub mod settle;
pub mod simulation;
#[cfg(test)]
mod slide;
pub mod step;
pub mod summary;
pub mod tick;
mod unconverged;
mod watch;
pub mod world;

pub use palpate_collision as collision;
pub use palpate_constraints as constraints;
pub use palpate_devices as drivers;
pub use palpate_fem as fem;
pub use palpate_haptics as haptics;
pub use palpate_solver as solver;
pub use palpate_trace as trace;

/// What most programs need.
pub mod prelude {
    pub use std::sync::atomic::AtomicBool;

    pub use crate::run::{Length, Observer, RunOptions, Unobserved, run};
    pub use crate::scene::{Scene, SceneDescription};
    pub use crate::simulation::Simulation;
    pub use crate::summary::RunSummary;
    pub use crate::world::World;
}
