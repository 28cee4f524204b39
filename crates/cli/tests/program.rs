//! What the program writes, and that it writes what it says.

mod program_runs;

use std::process::Stdio;

use palpate::fem::format;
use palpate::trace::Trace;
use program_runs::{NODES, Place, SCENE};
use serde_json::Value;

#[test]
fn a_run_writes_trace_picture_table_state_and_summary() {
    let place = Place::new();
    let run = place.run("run scene.toml --lockstep --csv steps.csv --final end.vtu --json");
    assert_eq!(run.code, Some(0), "{run:?}");
    assert_eq!(place.files(), ["end.vtu", "scene.toml", "small.mcap", "small.svg", "steps.csv"]);

    // Standard output holds JSON and nothing else.
    let summary: Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!(summary["end"], "completed");
    assert_eq!(summary["mode"], "lockstep");
    assert_eq!((&summary["steps"], &summary["ticks"]), (&30.into(), &1000.into()));
    assert_eq!(summary["nodes"], NODES);
    assert_eq!(summary["files"].as_array().unwrap().len(), 4);

    let trace = Trace::load(place.path("small.mcap")).unwrap();
    assert_eq!((trace.steps.len(), trace.ticks.len()), (30, 1000));
    let largest = trace.ticks.iter().map(|t| t.force.iter().map(|f| f * f).sum::<f64>().sqrt()).fold(0.0, f64::max);
    assert!(largest > 0.05, "the ball presses with {largest} N");
    let said = summary["largest_force"].as_f64().unwrap();
    assert!((largest - said).abs() <= 1e-12 * said, "trace {largest} N, summary {said} N");

    let mut table = csv::Reader::from_path(place.path("steps.csv")).unwrap();
    use palpate::summary::{ContactCounts, ForceCounts};
    let ticks = ForceCounts::NAMES.iter().chain(&ContactCounts::NAMES);
    let ticks: Vec<_> = ticks.map(|name| format!("ticks_{name}")).collect();
    let columns = palpate::step::StepReport::COLUMNS.iter().copied().chain(ticks.iter().map(String::as_str));
    assert!(table.headers().unwrap().iter().eq(columns), "{:?}", table.headers());
    let rows: Vec<Vec<f64>> =
        table.records().map(|row| row.unwrap().iter().map(|v| v.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 30);
    let column = |name: &str| palpate::step::StepReport::COLUMNS.iter().position(|&c| c == name).unwrap();
    for (k, row) in rows.iter().enumerate() {
        assert_eq!(row[column("step")], k as f64);
        assert!((row[column("time_s")] - k as f64 / 30.0).abs() < 1e-3, "step {k} at {} s", row[1]);
        let force = ["force_x_n", "force_y_n", "force_z_n"].map(|c| row[column(c)]);
        assert_eq!(force, trace.steps[k].tool_force, "step {k}: the table and the trace agree to the bit");
        assert_eq!(row[column("work_s")], 0.0, "no wall time in lockstep");
    }
    assert!(rows.iter().any(|row| row[column("force_z_n")] > 0.05 && row[column("contacts")] >= 1.0));
    // The first fade takes 0.3 s; nothing else acts on the force of a press.
    let of_ticks = |k: usize| rows.iter().map(|row| row[palpate::step::StepReport::COLUMNS.len() + k]).sum::<f64>();
    for (k, name) in ContactCounts::NAMES.iter().enumerate() {
        let counted = of_ticks(ForceCounts::NAMES.len() + k);
        assert_eq!(summary["port"]["contact"][*name].as_f64(), Some(counted), "{name}");
    }
    for (k, name) in ForceCounts::NAMES.iter().enumerate() {
        assert_eq!(of_ticks(k), if *name == "fading_in" { 300.0 } else { 0.0 }, "{name}");
        assert_eq!(summary["port"]["counts"][*name].as_f64(), Some(of_ticks(k)), "{name}");
    }

    let end = format::read(&place.path("end.vtu")).unwrap().mesh;
    assert_eq!(end.nodes.len(), NODES);
    assert!(end.nodes.iter().all(|x| x.iter().all(|c| c.is_finite())));
    assert!(place.read("end.vtu").windows(12).any(|w| w == b"displacement"));

    let picture = place.text("small.svg");
    assert!(picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>"));
    for label in ["force [N]", "indentation [mm]", "time [s]", "friction"] {
        assert!(picture.contains(label), "{label}");
    }
}

#[test]
fn equal_lockstep_runs_write_equal_files_with_any_number_of_workers() {
    let place = Place::new();
    for (name, threads) in [("a", 1), ("b", 2)] {
        let files = format!("--trace {name}.mcap --csv {name}.csv --final {name}.vtu --threads {threads}");
        assert_eq!(place.run(&format!("run scene.toml --lockstep --quiet {files}")).code, Some(0));
    }
    for ending in ["mcap", "csv", "vtu"] {
        assert!(place.read(&format!("a.{ending}")) == place.read(&format!("b.{ending}")), "{ending}");
    }
    assert!(place.read("a.mcap").len() > 10_000);
}

#[test]
fn a_lockstep_trace_replays_to_the_bit_and_one_that_was_tampered_with_does_not() {
    let place = Place::new();
    assert_eq!(place.run("run scene.toml --lockstep --steps 20").code, Some(0));
    let replay = place.run("replay small.mcap");
    assert_eq!(replay.code, Some(0), "{replay:?}");
    assert!(replay.out.contains("667 ticks, every force, torque and pose the same"), "{}", replay.out);

    // The scene that the trace carries has its checksum beside it, so a change is found out.
    let mut bytes = place.read("small.mcap");
    let at = bytes.windows(14).position(|w| w == b"young = 10e3, ").unwrap();
    bytes[at + 8] = b'2';
    std::fs::write(place.path("changed.mcap"), bytes).unwrap();
    let changed = place.run("replay changed.mcap");
    assert!(matches!(changed.code, Some(2 | 4)), "{changed:?}");
}

/// The program tells which part of a damaged trace is lost, compares the others, and ends with a code of its own.
#[test]
fn a_trace_with_a_damaged_part_is_replayed_without_it() {
    let place = Place::new();
    for (mode, everything_else) in [("--lockstep", true), ("", false)] {
        assert_eq!(place.run(&format!("run scene.toml {mode} --seconds 4 --quiet")).code, Some(0));
        let ticks = Trace::load(place.path("small.mcap")).unwrap().ticks.len();
        let mut bytes = place.read("small.mcap");
        // The first chunk of messages begins behind what describes the trace; the middle is in a later one.
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(place.path("bitten.mcap"), bytes).unwrap();
        let replay = place.run("replay bitten.mcap");
        assert_eq!(replay.code, Some(1), "{mode}: {replay:?}");
        for words in ["warning: bitten.mcap: the ", " bytes from byte ", " are damaged and lost", "cannot be compared"]
        {
            assert!(replay.err.contains(words), "{words}: {}", replay.err);
        }
        let compared: usize = replay.out.split_once(": ").unwrap().1.split_once(' ').unwrap().0.parse().unwrap();
        assert!(replay.out.contains("the same to the bit"), "{}", replay.out);
        // In virtual time what follows the lost part can be compared too.
        assert!(if everything_else { compared > 2000 } else { (500..3500).contains(&compared) }, "{}", replay.out);
        let lost = replay.err.rsplit_once("; ").unwrap().1.split_once(' ').unwrap().0;
        assert_eq!(compared + lost.parse::<usize>().unwrap(), ticks, "{mode}: {replay:?}");
    }
}

#[test]
fn a_step_count_and_seconds_end_the_run_where_they_say() {
    let place = Place::new();
    let json = |arguments: &str| -> Value {
        let run = place.run(&format!("run scene.toml --lockstep --no-trace --json {arguments}"));
        assert_eq!(run.code, Some(0), "{run:?}");
        serde_json::from_str(&run.out).unwrap()
    };
    assert_eq!(json("--steps 7")["steps"], 7);
    let half = json("--seconds 0.5");
    assert_eq!((&half["steps"], &half["ticks"]), (&15.into(), &500.into()));
    assert!(half["trace"].is_null() && half["files"] == Value::Array(vec![]));
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn the_command_line_replaces_mesh_and_cells() {
    let place = Place::new();
    assert_eq!(place.run("run scene.toml --lockstep --steps 1 --no-trace --final other.vtu").code, Some(0));
    let text = SCENE.replace("node_set = \"z_min\"", "below = { axis = \"z\", at = 0.001 }");
    place.write(
        "below.toml",
        &text.replace(
            "[[tool]]",
            "[body.regions]\nbone = { law = \"neo_hookean\", young = 1e6, poisson = 0.4 }\n\n[[tool]]",
        ),
    );
    let run = place.run("run below.toml --mesh other.vtu --lockstep --steps 3 --json --trace m.mcap");
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(run.err.contains("has no region `bone`"), "{}", run.err);
    assert_eq!(place.run("replay m.mcap").code, Some(0));

    // A file that is not there is told by the line that names it.
    place.write("absent.toml", &text.replace("block = {", "mesh = \"absent.vtu\" # {"));
    let run = place.run("check absent.toml");
    let line = text.lines().position(|line| line.starts_with("block = ")).unwrap() + 1;
    assert!(run.code == Some(2) && run.err.contains(&format!("[absent.toml:{line}:")), "{}", run.err);
    assert!(run.err.contains("there is no file") && run.err.contains("absent.vtu"), "{}", run.err);
    // A mistake that shows with the other mesh is one of the scene, in its own line.
    place.write("nothing.toml", &text.replace("at = 0.001", "at = -0.001"));
    let run = place.run("run nothing.toml --mesh other.vtu --lockstep --steps 3 --no-trace");
    let line = text.lines().position(|line| line.starts_with("fixed = ")).unwrap() + 1;
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.err.contains(&format!("[nothing.toml:{line}:")) && run.err.contains("at = -0.001"), "{}", run.err);

    let run = place.run("run liver --cell 40mm --lockstep --steps 1 --no-trace --json");
    assert_eq!(run.code, Some(0), "{run:?}");
    let nodes = serde_json::from_str::<Value>(&run.out).unwrap()["nodes"].as_u64().unwrap();
    assert!((50..400).contains(&nodes), "{nodes} nodes");
}

#[test]
fn check_says_what_was_understood_of_every_bundled_scene() {
    let place = Place::new();
    let listed = place.run("scenes");
    assert_eq!(listed.code, Some(0));
    for scene in palpate::scene::BUNDLED_SCENES {
        assert!(listed.out.lines().any(|l| l.starts_with(scene.name)), "{}", listed.out);
        let check = place.run(&format!("check {}", scene.name));
        assert_eq!((check.code, check.err.as_str()), (Some(0), ""), "{check:?}");
        for word in ["nodes", "kg", "young = ", "kind = ", "by compliance", "friction", "rates"] {
            assert!(check.out.contains(word), "{word}: {}", check.out);
        }
        assert!(!check.out.contains("warning"), "{}", check.out);
    }
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn a_reader_that_goes_away_is_no_mistake() {
    let place = Place::new();
    for command in ["scenes", "check scene.toml", "run scene.toml --lockstep --steps 1 --no-trace --json", "--help"] {
        let mut program = place.command(command);
        let mut child = program.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let err = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(0) && !err.contains("panicked"), "{command}: {:?} {err}", output.status);
    }
}

/// Ctrl-C ends a run early; what was written up to there is whole.
#[cfg(unix)]
mod interrupt {
    use std::process::{Child, Command};
    use std::time::{Duration, Instant};

    use palpate::replay::replay;

    use super::*;

    /// Waits until the run has begun: its trace has grown. Without an end of its own this would wait for ever.
    fn begun(place: &Place, child: &mut Child) {
        let start = Instant::now();
        while place.path("small.mcap").metadata().map_or(0, |m| m.len()) < 20_000 {
            assert!(child.try_wait().unwrap().is_none(), "the run ended by itself");
            assert!(start.elapsed() < Duration::from_secs(60), "the run did not begin");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn interrupt(arguments: &str, signal: &str, code: i32) {
        let place = Place::new();
        let mut command = place.command(&format!("run scene.toml --seconds 100000 --csv steps.csv --json {arguments}"));
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        begun(&place, &mut child);
        let killed = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let run = program_runs::Outcome::new(child.wait_with_output().unwrap());
        assert_eq!(run.code, Some(code), "{run:?}");
        let summary: Value = serde_json::from_str(&run.out).unwrap();
        assert_eq!(summary["end"], "interrupted");

        let trace = Trace::load(place.path("small.mcap")).unwrap();
        let kept = summary["ticks"].as_u64().unwrap() - summary["trace"]["dropped"].as_u64().unwrap();
        assert!(trace.ticks.len() as u64 >= kept && !trace.steps.is_empty(), "{} ticks", trace.ticks.len());
        assert!(place.text("small.svg").trim_end().ends_with("</svg>"));
        let rows = csv::Reader::from_path(place.path("steps.csv")).unwrap().records().map(Result::unwrap).count();
        assert_eq!(rows as u64, summary["steps"].as_u64().unwrap());
        if arguments.contains("--lockstep") {
            assert!(replay(&place.path("small.mcap")).unwrap().is_identical());
        }
    }

    /// Whether a program has its own handler for INT.
    #[cfg(target_os = "linux")]
    fn handles_int(child: &Child) -> bool {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap_or("0").trim();
        u64::from_str_radix(mask, 16).unwrap() >> 1 & 1 == 1
    }

    /// It tells how far it came. The signal finds it reading its trace, so that it ends before its first step.
    #[cfg(target_os = "linux")]
    #[test]
    fn of_a_replay() {
        let place = Place::new();
        let run = place.run("run scene.toml --seconds 10 --lockstep --quiet");
        assert_eq!(run.code, Some(0), "{run:?}");
        let mut child = place.command("replay small.mcap").stdout(Stdio::piped()).spawn().unwrap();
        while !handles_int(&child) {
            assert!(child.try_wait().unwrap().is_none(), "the replay ended by itself");
            std::thread::sleep(Duration::from_millis(1));
        }
        let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let replay = program_runs::Outcome::new(child.wait_with_output().unwrap());
        assert_eq!(replay.code, Some(130), "{replay:?}");
        assert!(replay.out.contains("interrupted after") && replay.out.contains("of 10000 ticks"), "{replay:?}");
    }

    /// What was written before the end can be replayed.
    #[test]
    fn a_run_that_was_killed() {
        for mode in ["", "--lockstep"] {
            let place = Place::new();
            let mut command = place.command(&format!("run scene.toml --seconds 100000 --quiet {mode}"));
            let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
            begun(&place, &mut child);
            // The kill may fall into the first chunk, of which nothing is read.
            let start = Instant::now();
            while place.run("replay small.mcap").code == Some(2) {
                assert!(start.elapsed() < Duration::from_secs(60), "no whole chunk was written");
                std::thread::sleep(Duration::from_millis(20));
            }
            child.kill().unwrap();
            child.wait().unwrap();
            let replay = place.run("replay small.mcap");
            let told = replay.err.contains("warning: small.mcap") && replay.out.contains("the same to the bit");
            assert!(replay.code == Some(0) && told, "{mode}: {replay:?}");
        }
    }

    /// Known on Linux.
    fn hup_is_ignored() -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap_or("0").trim();
        u64::from_str_radix(mask, 16).unwrap() & 1 == 1
    }

    #[test]
    fn in_real_time() {
        interrupt("", "-INT", 130);
    }

    #[test]
    fn in_lockstep() {
        interrupt("--lockstep", "-INT", 130);
    }

    /// The exit code is what a shell reports for the signal.
    #[test]
    fn by_another_signal() {
        interrupt("", "-TERM", 143);
        if hup_is_ignored() {
            println!("skipped: HUP is ignored here, as under nohup, and so it is by programs that are started");
            return;
        }
        interrupt("", "-HUP", 129);
    }
}
