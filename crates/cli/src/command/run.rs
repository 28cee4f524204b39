//! `palpate run`.

use std::path::Path;

use miette::{IntoDiagnostic, Report, Result, miette};
use palpate::counted::counted;
use palpate::export::write_state;
use palpate::problem_files::saved_in;
use palpate::run::{Length, Observer, Progress, RunOptions, RunOutcome, run as run_scene};
use palpate::scene::Scene;
use palpate::step::StepReport;
use palpate::summary::{RunEnd, RunSummary};
use palpate::tick::TickReport;
use palpate::world::World;

use crate::arguments::RunArguments;
use crate::exit;
use crate::output::{Outputs, make_folder, say, scene_files};
use crate::picture::{self, Curves};
use crate::progress::ProgressLine;
use crate::step_table::StepTable;
use crate::stop::Stop;
use crate::table;

pub(crate) fn run(arguments: &RunArguments) -> Result<u8> {
    let scene = scene(arguments)?;
    let mut outputs = Outputs::new(arguments, scene.name());
    let untraced = outputs.check(&scene_files(&arguments.scene, &scene))?;
    let world = scene.build().map_err(super::report)?;
    if let Some(folder) = &arguments.save_problems {
        clear_problems(folder, arguments.force)?;
        make_folder("--save-problems", folder)?;
    }
    for warning in world.warnings().iter().chain(&untraced) {
        eprintln!("warning: {warning}");
    }
    let stop = Stop::watch()?;
    let options = RunOptions {
        length: match (arguments.steps, arguments.seconds) {
            (Some(steps), _) => Length::Steps(steps),
            (None, seconds) => Length::Seconds(seconds.unwrap_or(scene.seconds())),
        },
        lockstep: arguments.lockstep,
        threads: arguments.threads,
        trace: outputs.trace.clone(),
        problems: arguments.save_problems.clone(),
        ..RunOptions::default()
    };
    let mut watcher = Watcher {
        line: (!arguments.quiet).then(|| ProgressLine::new(options.length.seconds(world.dt()))),
        curves: outputs.picture.is_some().then(Curves::default),
        table: outputs.csv.as_deref().map(|path| StepTable::new(path, !arguments.lockstep)),
    };
    let mut outcome = run_scene(&world, &options, stop.flag(), &mut watcher).map_err(|e| Report::msg(e.to_string()))?;
    if let Some(line) = &watcher.line {
        line.finish();
    }
    let mut lost: Vec<_> = untraced.into_iter().collect();
    write(&outputs, watcher, &world, &mut outcome, &mut lost);
    let summary = &mut outcome.summary;
    let whole = lost.is_empty() && summary.trace.as_ref().is_none_or(|t| t.error.is_none());
    summary.notes.append(&mut lost);
    print(summary, arguments.json)?;
    Ok(match summary.end {
        RunEnd::BodyFailed => exit::BODY_FAILED,
        RunEnd::Interrupted => stop.code(),
        RunEnd::Completed if whole => 0,
        RunEnd::Completed => exit::FILE_LOST,
    })
}

/// Sees to it that the problems of an earlier run do not mix with those of this one.
fn clear_problems(folder: &Path, force: bool) -> Result<()> {
    let told = |e: &dyn std::fmt::Display| {
        let help = "name a folder that can be made or read";
        miette!(help = help, "--save-problems {}: {e}", folder.display())
    };
    let earlier = saved_in(folder).map_err(|e| told(&e))?;
    match earlier.first() {
        Some(first) if !force => {
            let name = first.file_name().unwrap_or_default().display();
            let help = "name another folder, or give --force to remove them; other files there are kept";
            let folder = folder.display();
            Err(miette!(
                help = help,
                "--save-problems {folder}: holds {} of an earlier run: {name}",
                counted(earlier.len(), "problem", "problems")
            ))
        }
        _ => earlier.iter().try_for_each(|file| {
            std::fs::remove_file(file).map_err(|e| told(&format!("{} cannot be removed: {e}", file.display())))
        }),
    }
}

/// The scene with the changes that the command line asks for.
fn scene(arguments: &RunArguments) -> Result<Scene> {
    let mut scene = Scene::open(&arguments.scene).map_err(super::report)?;
    if let Some(mesh) = &arguments.mesh {
        for region in scene.use_mesh(mesh, arguments.scale.unwrap_or(1.0)).map_err(super::report)? {
            eprintln!("warning: {} has no region `{region}`: its material is not used", mesh.display());
        }
    }
    if let Some(cell) = arguments.cell {
        if scene.description().bodies[0].image.is_none() {
            let help = "leave --cell out; it sizes tetrahedra that are made from an image or a closed surface";
            return Err(miette!(help = help, "--cell: the body of {} brings its own tetrahedra", arguments.scene));
        }
        scene.use_cell(cell).map_err(super::report)?;
    }
    Ok(scene)
}

/// Writes table, picture and end state; what cannot be written is told in `lost`, for the run itself is not.
fn write(outputs: &Outputs, watcher: Watcher, world: &World, outcome: &mut RunOutcome, lost: &mut Vec<String>) {
    let RunOutcome { summary, state, phase } = outcome;
    if let Some(table) = watcher.table {
        table.finish().map_or_else(|e| lost.push(e), |path| summary.files.push(path));
    }
    if let (Some(path), Some(curves)) = (&outputs.picture, &watcher.curves) {
        match picture::draw(path, &format!("{}: force and depth", summary.scene), curves) {
            Ok(()) => summary.files.push(path.clone()),
            Err(error) => lost.push(format!("{}: no picture: {error}", path.display())),
        }
    }
    if let Some(path) = &outputs.final_state {
        match write_state(path, world.phase(*phase), state) {
            Ok(()) => summary.files.push(path.clone()),
            Err(error) => lost.push(error.to_string()),
        }
    }
}

fn print(summary: &RunSummary, json: bool) -> Result<()> {
    if json { say(serde_json::to_string_pretty(summary).into_diagnostic()?) } else { say(table::summary(summary)) }
}

/// What the program does with a run while it goes on.
struct Watcher {
    line: Option<ProgressLine>,
    /// None where no picture is drawn.
    curves: Option<Curves>,
    table: Option<StepTable>,
}

impl Observer for Watcher {
    fn progress(&mut self, progress: &Progress) {
        if let Some(line) = &self.line {
            line.show(progress);
        }
    }

    fn step(&mut self, report: &StepReport) {
        if let Some(curves) = &mut self.curves {
            curves.friction.push(report.time, report.tangential_force);
            curves.depth.push(report.time, report.indentation);
        }
        if let Some(table) = &mut self.table {
            table.write(report);
        }
    }

    fn tick(&mut self, report: &TickReport) {
        if let Some(curves) = &mut self.curves {
            curves.force.push(report.record.time, report.record.wrench.force.norm());
        }
        if let Some(table) = &mut self.table {
            table.tick(report);
        }
    }
}
