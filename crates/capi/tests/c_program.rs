//! Does a C program compile against the header, link both ways, feel a body as it should, and leave no memory behind?
//!
//! Needs a C compiler; says so and returns where there is none.

#![cfg(unix)] // shared libraries by their Unix names
#![allow(clippy::print_stdout)] // what the programs printed, and why a test was skipped

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap().to_path_buf()
}

/// Whether a program of this name answers.
fn has(program: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    if !found {
        // Past the capture of a test that passes.
        let _ = writeln!(std::io::stderr(), "skipped: there is no {program} here");
    }
    found
}

/// Runs a command that must succeed.
fn succeed(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let texts = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success(), "{command:?}: {}\n{}\n{}", output.status, texts[0], texts[1]);
    output
}

/// A folder with libpalpate.so and libpalpate.a, which cargo has built for this test under the crate's own name.
fn libraries() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let built = std::env::current_exe().unwrap().parent().unwrap().to_path_buf();
    for ending in ["so", "a"] {
        let name = format!("libpalpate_capi.{ending}");
        let candidates = [built.join(&name), built.parent().unwrap().join(&name)];
        let newest = candidates.iter().filter(|p| p.exists()).max_by_key(|p| p.metadata().unwrap().modified().unwrap());
        let from = newest.unwrap_or_else(|| panic!("cargo has built no {name} in {}", built.display()));
        std::os::unix::fs::symlink(from, folder.path().join(format!("libpalpate.{ending}"))).unwrap();
    }
    folder
}

const WARNINGS: [&str; 4] = ["-Wall", "-Wextra", "-pedantic", "-Werror"];

fn compiler(compiler: &str, standard: &str) -> Command {
    let mut command = Command::new(compiler);
    command.arg(format!("-std={standard}")).args(WARNINGS).arg("-pthread");
    command.arg("-I").arg(root().join("crates/capi/include"));
    command
}

fn program() -> PathBuf {
    root().join("examples/c/palpate_pthread.c")
}

/// The number after `word` on the line that begins with `line`.
fn number(text: &str, line: &str, word: &str) -> f64 {
    let line = text.lines().find(|l| l.starts_with(line)).unwrap_or_else(|| panic!("no line `{line}` in\n{text}"));
    let rest = line.split(word).nth(1).unwrap_or_else(|| panic!("no `{word}` in `{line}`"));
    let end = rest.trim_start().find(|c: char| !"+-.0123456789e".contains(c)).unwrap_or(rest.trim_start().len());
    rest.trim_start()[..end].parse().unwrap_or_else(|e| panic!("`{line}` after `{word}`: {e}"))
}

/// What the example must print, whoever linked it: no force in air, and one that opposes penetration and grows with it.
fn check_physics(text: &str) {
    println!("{text}");
    assert!(number(text, "free:", "free:") > 10.0, "the ball begins in air");
    assert_eq!(number(text, "free:", "largest force"), 0.0);
    let depths: Vec<&str> = text.lines().filter(|l| l.starts_with("depth")).collect();
    assert!(depths.len() >= 3, "the ball is pressed in by some millimetres");
    let forces: Vec<[f64; 2]> =
        depths.iter().map(|line| [number(line, "depth", "force"), number(line, "depth", "upwards")]).collect();
    for [force, upwards] in &forces[1..] {
        assert!(*upwards > 0.9 * force && *force > 0.0, "the force is against the penetration");
    }
    // The screen saw the whole body move: the ball goes down by some millimetres, the hand's spring takes the rest.
    let dent = number(text, "screen:", "dent");
    assert!(number(text, "screen:", "screen:") > 3.0 && (0.5..8.0).contains(&dent), "{dent} mm");
    // From one millimetre of depth on, where the ramp after the start has ended.
    assert!(forces[1..].windows(2).all(|w| w[1][0] > w[0][0]), "the force grows with the depth: {forces:?}");
    let largest = number(text, "largest force", "largest force");
    assert!(largest <= 6.0 && largest >= forces[forces.len() - 1][0] * 0.9, "{largest} N");
    assert_eq!(number(text, "largest force", "late,"), 0.0, "no tick is refused");
    assert!(text.contains("phase running"));
}

/// The example, built against the shared library among these.
fn built_shared(libraries: &tempfile::TempDir) -> PathBuf {
    let built = libraries.path().join("shared");
    let mut command = compiler("cc", "c99");
    command.arg(program()).arg("-o").arg(&built).arg("-L").arg(libraries.path()).args(["-lpalpate", "-lm"]);
    succeed(&mut command);
    built
}

#[test]
fn the_example_feels_the_body_through_the_shared_library() {
    if !has("cc") {
        return;
    }
    let libraries = libraries();
    let built = built_shared(&libraries);
    let output = succeed(Command::new(&built).args(["block", "3"]).env("LD_LIBRARY_PATH", libraries.path()));
    check_physics(&String::from_utf8(output.stdout).unwrap());
}

#[test]
fn the_example_feels_the_body_through_the_static_library_and_the_address_sanitizer() {
    if !has("cc") {
        return;
    }
    let libraries = libraries();
    let built = libraries.path().join("static");
    let mut command = compiler("cc", "c99");
    command.args(["-g", "-fsanitize=address", "-fno-omit-frame-pointer"]).arg(program()).arg("-o").arg(&built);
    succeed(command.arg(libraries.path().join("libpalpate.a")).args(["-lm", "-ldl"]));
    let output = succeed(Command::new(&built).args(["block", "3"]).env("ASAN_OPTIONS", "detect_leaks=0"));
    check_physics(&String::from_utf8(output.stdout).unwrap());
}

#[test]
fn the_example_finds_bodies_of_other_sizes_and_draws_one_that_is_cut() {
    if !has("cc") {
        return;
    }
    let libraries = libraries();
    let built = built_shared(&libraries);
    for scene in ["liver", "cut", "grasp"] {
        let output = succeed(Command::new(&built).args([scene, "2"]).env("LD_LIBRARY_PATH", libraries.path()));
        let text = String::from_utf8(output.stdout).unwrap();
        println!("{text}");
        assert_eq!(number(&text, "free:", "largest force"), 0.0);
        let deepest = text.lines().rfind(|l| l.starts_with("depth")).unwrap_or_else(|| panic!("no depth in\n{text}"));
        assert!(number(deepest, "depth", "force") > 0.05 && number(deepest, "depth", "upwards") > 0.05, "{text}");
    }
}

#[test]
fn a_mistake_is_a_message_and_an_exit_code() {
    if !has("cc") {
        return;
    }
    let libraries = libraries();
    let built = built_shared(&libraries);
    let output = Command::new(&built).arg("bolck").env("LD_LIBRARY_PATH", libraries.path()).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("create:") && message.contains("did you mean `block`?"), "{message}");
}

/// Uses every function, frees all, in the order that is hardest: the port after its simulation.
const LIFE: &str = r#"
#include "palpate.h"
#include <stdio.h>
#include <string.h>

int main(void)
{
    palpate_options options;
    palpate_input in;
    palpate_output out;
    palpate_statistics_data statistics;
    palpate_simulation *simulation = 0;
    palpate_port *port = 0;
    int k;
    memset(&options, 0, sizeof options);
    memset(&in, 0, sizeof in);
    memset(&out, 0, sizeof out);
    memset(&statistics, 0, sizeof statistics);
    options.struct_size = sizeof options;
    options.threads = 1;
    in.struct_size = sizeof in;
    out.struct_size = sizeof out;
    statistics.struct_size = sizeof statistics;
    if (palpate_create_from_string(SCENE, ".", &options, &simulation) != PALPATE_STATUS_OK ||
        palpate_open_port(simulation, &port) != PALPATE_STATUS_OK || palpate_start(simulation) != PALPATE_STATUS_OK) {
        fprintf(stderr, "%s\n", palpate_last_error());
        return 1;
    }
    for (k = 0; k < 200; k++) {
        in.position[2] = k % 2 ? -0.014 : -0.01;
        if (palpate_tick(port, &in, &out) < 0) return 2;
    }
    if (palpate_pause(simulation) || palpate_resume(simulation) || palpate_statistics(simulation, &statistics)) return 3;
    if (palpate_stop(simulation) || palpate_destroy(simulation)) return 4;
    if (palpate_tick(port, &in, &out) < 0 || out.phase != PALPATE_PHASE_STOPPED) return 5;
    if (palpate_close_port(port)) return 6;
    printf("%s, %s, tick %llu\n", palpate_version(), palpate_status_text(PALPATE_STATUS_ERROR_BUSY),
           (unsigned long long)out.tick);
    return 0;
}
"#;

const SCENE: &str = r#"name = 'tiny'
[[body]]
name = 'block'
block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [1, 1, 1] }
material = { law = 'linear', young = 5e3, poisson = 0.4 }
fixed = [{ below = { axis = 'z', at = 0.0 } }]
[[tool]]
name = 'ball'
shape = { kind = 'sphere', radius = 0.008 }
[device]
kind = 'port'
origin = [0.02, 0.02, 0.06]
"#;

fn life_program(folder: &Path) -> PathBuf {
    let source = folder.join("life.c");
    let scene = SCENE.lines().map(|line| format!("\"{line}\\n\"")).collect::<Vec<_>>().join(" ");
    std::fs::write(&source, format!("#define SCENE {scene}\n{LIFE}")).unwrap();
    source
}

#[test]
fn a_life_leaves_no_memory_behind_and_touches_none_that_is_not_its_own() {
    if !has("cc") || !has("valgrind") {
        return;
    }
    let libraries = libraries();
    let built = libraries.path().join("life");
    let mut command = compiler("cc", "c99");
    command.arg("-g").arg(life_program(libraries.path())).arg("-o").arg(&built);
    succeed(command.arg(libraries.path().join("libpalpate.a")).args(["-lm", "-ldl"]));
    let mut command = Command::new("valgrind");
    // rayon keeps its pool's threads for the process's life: only what nobody can reach any more is a leak.
    command.args(["--quiet", "--leak-check=full", "--show-leak-kinds=definite", "--errors-for-leak-kinds=definite"]);
    // Optimised code compares bytes that carry nothing before it looks whether they do, which is no error.
    command.arg("--undef-value-errors=no");
    let output = succeed(command.arg("--error-exitcode=9").arg(&built));
    println!("{}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn the_header_is_also_c_plus_plus() {
    if !has("c++") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("header.cpp");
    let text = "#include \"palpate.h\"\nint main() { palpate_input in{}; in.struct_size = sizeof in;\n\
                palpate_output out{}; return palpate_tick(nullptr, &in, &out) == PALPATE_STATUS_ERROR_NULL ? 0 : 1; }\n";
    std::fs::write(&source, text).unwrap();
    for standard in ["c++11", "c++20"] {
        succeed(compiler("c++", standard).arg("-fsyntax-only").arg(&source));
    }
}
