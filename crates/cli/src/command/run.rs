//! `palpate run`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use miette::{IntoDiagnostic, Report, Result, WrapErr, miette};
use palpate::export::write_state;
use palpate::run::{Length, Observer, Progress, RunOptions, run as run_scene};
use palpate::scene::Scene;
use palpate::step::StepReport;
use palpate::summary::{RunEnd, RunSummary};
use palpate::tick::TickReport;

use crate::arguments::RunArguments;
use crate::picture::{self, Curves};
use crate::progress::ProgressLine;
use crate::table;

/// Exit code of a run whose body failed: it was rolled back, and its trace is complete.
const BODY_FAILED: u8 = 3;

pub(crate) fn run(arguments: &RunArguments) -> Result<ExitCode> {
    let mut scene = Scene::open(&arguments.scene).map_err(super::report)?;
    if let Some(mesh) = &arguments.mesh {
        scene.use_mesh(mesh, arguments.scale.unwrap_or(1.0)).map_err(super::report)?;
    }
    if let Some(cell) = arguments.cell {
        scene.use_cell(cell).map_err(super::report)?;
    }
    let trace = trace_path(arguments, scene.name());
    let world = scene.build().map_err(super::report)?;
    for warning in world.warnings() {
        eprintln!("warning: {warning}");
    }
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if asked.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    })
    .into_diagnostic()
    .wrap_err("Ctrl-C cannot be watched")?;

    let options = RunOptions {
        length: length(arguments, scene.seconds())?,
        lockstep: arguments.lockstep,
        threads: arguments.threads,
        trace: trace.clone(),
    };
    let total = options.length.seconds(world.dt());
    let mut watcher = Watcher {
        line: (!arguments.quiet).then(|| ProgressLine::new(total)),
        curves: Curves::default(),
        csv: arguments.csv.as_deref().map(StepTable::create).transpose()?,
    };
    let mut outcome = run_scene(&world, &options, &stop, &mut watcher).map_err(|e| Report::msg(e.to_string()))?;
    if let Some(line) = &watcher.line {
        line.finish();
    }
    if let (Some(table), Some(path)) = (watcher.csv, &arguments.csv) {
        table.finish()?;
        outcome.summary.files.push(path.clone());
    }
    if let Some(trace) = &trace {
        let picture = trace.with_extension("svg");
        match picture::draw(&picture, &format!("{}: force and depth", outcome.summary.scene), &watcher.curves) {
            Ok(()) => outcome.summary.files.push(picture),
            Err(error) => outcome.summary.notes.push(format!("{}: no picture: {error}", picture.display())),
        }
    }
    if let Some(path) = &arguments.final_state {
        write_state(path, &world, &outcome.state).map_err(|e| miette!("{e}"))?;
        outcome.summary.files.push(path.clone());
    }
    print(&outcome.summary, arguments.json)?;
    Ok(if outcome.summary.end == RunEnd::BodyFailed { ExitCode::from(BODY_FAILED) } else { ExitCode::SUCCESS })
}

#[allow(clippy::print_stdout)]
fn print(summary: &RunSummary, json: bool) -> Result<()> {
    if json {
        println!("{}", serde_json::to_string_pretty(summary).into_diagnostic()?);
    } else {
        println!("{}", table::summary(summary));
    }
    Ok(())
}

fn length(arguments: &RunArguments, scene_seconds: f64) -> Result<Length> {
    let seconds = arguments.seconds.unwrap_or(scene_seconds);
    match arguments.steps {
        Some(0) => Err(miette!("--steps 0 runs nothing; give at least 1")),
        Some(steps) => Ok(Length::Steps(steps)),
        None if seconds > 0.0 && seconds.is_finite() => Ok(Length::Seconds(seconds)),
        None => Err(miette!("--seconds {seconds} is not a positive time")),
    }
}

fn trace_path(arguments: &RunArguments, name: &str) -> Option<PathBuf> {
    if arguments.no_trace {
        return None;
    }
    Some(arguments.trace.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.mcap"))))
}

/// What the program does with a run while it goes on.
struct Watcher {
    line: Option<ProgressLine>,
    curves: Curves,
    csv: Option<StepTable>,
}

impl Observer for Watcher {
    fn progress(&mut self, progress: &Progress) {
        if let Some(line) = &self.line {
            line.show(progress);
        }
    }

    fn step(&mut self, report: &StepReport) {
        self.curves.friction.push((report.time, report.tangential_force));
        self.curves.depth.push((report.time, report.indentation));
        if let Some(csv) = &mut self.csv {
            csv.write(report);
        }
    }

    fn tick(&mut self, report: &TickReport) {
        self.curves.force.push((report.record.time, report.record.wrench.force.norm()));
    }
}

/// The CSV table of steps. Writing errors are kept and told at the end: a full disk does not end a simulation.
struct StepTable {
    path: PathBuf,
    writer: csv::Writer<std::fs::File>,
    error: Option<csv::Error>,
}

impl StepTable {
    fn create(path: &Path) -> Result<Self> {
        let mut writer =
            csv::Writer::from_path(path).into_diagnostic().wrap_err_with(|| format!("{}: no CSV", path.display()))?;
        writer.write_record(StepReport::COLUMNS).into_diagnostic()?;
        Ok(Self { path: path.into(), writer, error: None })
    }

    fn write(&mut self, report: &StepReport) {
        if self.error.is_none() {
            self.error = self.writer.write_record(report.row().iter().map(f64::to_string)).err();
        }
    }

    fn finish(mut self) -> Result<()> {
        let flushed = self.writer.flush().into_diagnostic();
        match self.error {
            Some(error) => Err(error).into_diagnostic(),
            None => flushed,
        }
        .wrap_err_with(|| format!("{}: the CSV is incomplete", self.path.display()))
    }
}
