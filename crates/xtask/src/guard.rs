//! The guards of the project, each one a few commands that must succeed.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

pub(crate) type Outcome = Result<(), String>;

struct Guard {
    name: &'static str,
    what: &'static str,
    run: fn() -> Outcome,
}

/// All guards in the order in which they run: cheap ones first, each reusing what the former built.
const GUARDS: &[Guard] = &[
    Guard { name: "format", what: "the source is formatted", run: format },
    Guard { name: "lint", what: "clippy has no complaint", run: lint },
    Guard { name: "docs", what: "the documentation builds without warnings", run: docs },
    Guard { name: "test", what: "unit and truth tests", run: test },
    Guard { name: "examples", what: "every example runs", run: examples },
    Guard { name: "program", what: "the program runs a scene and writes what it says", run: program },
    Guard { name: "embed", what: "the C example builds by its Makefile and runs", run: embed },
    Guard { name: "trace", what: "an independent reader decodes the trace", run: trace },
    Guard { name: "realtime", what: "RealtimeSanitizer finds nothing in the tick and in palpate_tick", run: realtime },
    Guard { name: "loom", what: "every order of two threads hands values over whole", run: crate::loom::check },
];

/// Runs the chosen guards; stops at the first that fails.
pub(crate) fn run(only: &[String], skip: &[String]) -> Outcome {
    for name in only.iter().chain(skip) {
        if !GUARDS.iter().any(|g| g.name == name) {
            let names: Vec<_> = GUARDS.iter().map(|g| g.name).collect();
            return Err(format!("there is no guard `{name}`; the guards are {}", names.join(", ")));
        }
    }
    let chosen =
        |g: &&Guard| (only.is_empty() || only.iter().any(|n| n == g.name)) && !skip.iter().any(|n| n == g.name);
    let mut lines = Vec::new();
    for guard in GUARDS.iter().filter(chosen) {
        println!("\n=== {}: {}", guard.name, guard.what);
        let start = Instant::now();
        (guard.run)().map_err(|e| format!("guard `{}` failed: {e}", guard.name))?;
        lines.push(format!("{:>10}  ok  {:6.1} s", guard.name, start.elapsed().as_secs_f64()));
    }
    println!("\n{}", lines.join("\n"));
    println!("{} passed, 0 failed", lines.len());
    Ok(())
}

/// The root of the workspace.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new(".")).to_path_buf()
}

/// A folder for what the guards write.
fn output_folder() -> Result<PathBuf, String> {
    let folder = root().join("target/guards");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(folder)
}

pub(crate) fn execute(command: &mut Command) -> Outcome {
    let shown = format!("{command:?}");
    println!("$ {shown}");
    let status = command.current_dir(root()).status().map_err(|e| format!("{shown}: {e}"))?;
    if status.success() { Ok(()) } else { Err(format!("{shown}: {status}")) }
}

pub(crate) fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".into()));
    command.args(arguments);
    command
}

fn format() -> Outcome {
    execute(&mut cargo(&["fmt", "--all", "--check"]))
}

fn lint() -> Outcome {
    execute(&mut cargo(&["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"]))
}

fn docs() -> Outcome {
    execute(cargo(&["doc", "--release", "--workspace", "--no-deps", "--quiet"]).env("RUSTDOCFLAGS", "-D warnings"))
}

fn test() -> Outcome {
    execute(&mut cargo(&["test", "--release", "--workspace"]))
}

/// Writes the header of the C library; the test that compares it is what knows how.
pub(crate) fn write_header() -> Outcome {
    let mut command = cargo(&["test", "--release", "--package", "palpate-capi", "--test", "header"]);
    execute(command.env("PALPATE_WRITE_HEADER", "1"))
}

/// Builds what the tests have built, so that the guards after them compile nothing: a command for one package alone would
/// choose fewer features of shared dependencies and compile all of them once more.
fn build() -> Outcome {
    execute(&mut cargo(&["build", "--release", "--workspace", "--lib", "--bins", "--examples", "--tests"]))
}

/// A program that [`build`] made, by its path below the folder of the profile.
fn built(program: &str) -> Command {
    Command::new(root().join("target/release").join(program))
}

/// Every example of the root package, found by its file.
fn examples() -> Outcome {
    build()?;
    let folder = root().join("examples");
    let mut names: Vec<String> = std::fs::read_dir(&folder)
        .map_err(|e| format!("{}: {e}", folder.display()))?
        .filter_map(|entry| entry.ok()?.path().file_name()?.to_str()?.strip_suffix(".rs").map(String::from))
        .collect();
    names.sort();
    for name in names {
        execute(&mut built(&format!("examples/{name}")))?;
    }
    Ok(())
}

/// Runs the bundled scene in lockstep, replays its trace, and looks at every file that it wrote.
fn program() -> Outcome {
    build()?;
    let palpate = |arguments: &[&str]| execute(built("palpate").args(arguments));
    let out = output_folder()?;
    let path = |name: &str| out.join(name).to_string_lossy().into_owned();
    let (trace, state, csv) = (path("liver.mcap"), path("liver.vtu"), path("liver.csv"));
    let files = ["--trace", &trace, "--final", &state, "--csv", &csv];
    palpate(&[&["run", "liver", "--lockstep", "--steps", "90", "--quiet"], &files[..]].concat())?;
    for file in [&trace, &state, &csv, &path("liver.svg")] {
        let length = std::fs::metadata(file).map_err(|e| format!("{file}: {e}"))?.len();
        if length < 500 {
            return Err(format!("{file} holds only {length} bytes"));
        }
    }
    palpate(&["replay", &trace])?;
    palpate(&["check", "liver"])?;
    palpate(&["mesh", &state])?;
    palpate(&["scenes"])?;
    palpate(&["run", "liver", "--seconds", "1", "--no-trace", "--json", "--quiet"])
}

/// Builds the C library, and its example as a user does, and runs it linked both ways.
fn embed() -> Outcome {
    let out = output_folder()?.join("c");
    let folder = format!("BUILD={}", out.display());
    build()?;
    execute(Command::new("make").args(["--directory", "examples/c", &folder]))?;
    for linked in ["shared", "static"] {
        execute(Command::new(out.join(linked)).args(["block", "2"]))?;
    }
    Ok(())
}

/// Reads the trace of [`program`] with the `mcap` package of PyPI, and its end state with meshio.
fn trace() -> Outcome {
    let out = output_folder()?;
    let environment = root().join("target/guards/venv");
    let python = environment.join("bin/python");
    if !python.exists() {
        execute(Command::new("python3").args(["-m", "venv"]).arg(&environment))?;
    }
    execute(Command::new(&python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).args([
        "mcap>=1.2,<2",
        "mcap-protobuf-support>=0.5,<1",
        "meshio>=5.3,<6",
    ]))?;
    execute(Command::new(&python).arg("crates/trace/tests/read_trace.py").arg(out.join("liver.mcap")))?;
    execute(
        Command::new(&python)
            .args(["-c", "import sys, meshio; m = meshio.read(sys.argv[1]); print(m); assert m.cells_dict['tetra'].shape[1] == 4"])
            .arg(out.join("liver.vtu")),
    )
}

/// Runs the tick, and a driver on the C library with all its threads, under RealtimeSanitizer, which ships with the
/// toolchain for Linux on x86-64.
fn realtime() -> Outcome {
    const TARGET: &str = "x86_64-unknown-linux-gnu";
    const FOLDER: &str = "target/rtsan";
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        println!("skipped: RealtimeSanitizer is not part of the toolchain for this machine");
        return Ok(());
    }
    // One command for both packages, so that their features are one set and nothing is compiled twice.
    let mut command = cargo(&["build", "--profile", "sanitized", "--target", TARGET, "--target-dir", FOLDER]);
    command.args(["--package", "palpate-haptics", "--example", "rtsan_tick"]);
    command.args(["--package", "palpate-capi", "--example", "rtsan_driver"]);
    // The sanitizer is an unstable flag of a stable compiler; the variable admits it for this build alone.
    execute(command.env("RUSTC_BOOTSTRAP", "1").env("RUSTFLAGS", "-Zsanitizer=realtime --cfg rtsan"))?;
    let programs = root().join(FOLDER).join(TARGET).join("sanitized/examples");
    // What it must find: that it is there.
    let mut provoked = Command::new(programs.join("rtsan_tick"));
    let provoked = provoked.arg("provoke").output().map_err(|e| format!("rtsan_tick provoke: {e}"))?;
    if provoked.status.success() || !String::from_utf8_lossy(&provoked.stderr).contains("RealtimeSanitizer") {
        return Err("an allocation in a real-time function went unseen".into());
    }
    ["rtsan_tick", "rtsan_driver"].iter().try_for_each(|name| execute(&mut Command::new(programs.join(name))))
}
