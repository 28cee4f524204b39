//! How `palpate solve` ends where something is in its way: a file that cannot be written whole, Ctrl-C, a link to its input.
#![cfg(unix)]

mod program_runs;

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use program_runs::{Outcome, Place};

/// One contact without friction, as Siconos writes it.
const ONE: &str = "1\n0\n1\n1\n1\n1\n2\n-1\n";

/// So many masses in a row, of which each pushes the next: sweeps take about the square of their number.
fn chain(n: usize) -> String {
    let entry = |i: usize, j: usize| {
        if i == j {
            "2"
        } else if i.abs_diff(j) == 1 {
            "-1"
        } else {
            "0"
        }
    };
    let row = |i: usize| (0..n).map(|j| entry(i, j)).collect::<Vec<_>>().join(" ") + "\n";
    let rows: String = (0..n).map(row).collect();
    format!("{n}\n0\n{n}\n{n}\n{n}\n{n}\n{rows}{}\n", vec!["-1"; n].join(" "))
}

/// One file, and sweeps over chains that no test can wait for: minutes.
fn endless() -> String {
    let chains = " chain.dat".repeat(50);
    format!("solve one.dat{chains} --solver gauss_seidel --tol 1e-15 --max-iter 4000000000")
}

fn place() -> Place {
    let place = Place::new();
    place.write("one.dat", ONE);
    place.write("chain.dat", &chain(250));
    place
}

fn interrupt(id: u32) {
    assert!(Command::new("kill").args(["-INT", &id.to_string()]).status().unwrap().success());
}

#[test]
fn a_solution_that_cannot_be_written_whole_is_a_lost_file_and_no_mistake() {
    let place = place();
    let run = place.run("solve one.dat --out /dev/full");
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(run.out.contains("solved") && run.err.contains("--out /dev/full"), "{run:?}");
    assert!(run.out.contains("one.dat: 1 block, 1 row\n"), "{}", run.out);
    let run = place.run("solve one.dat --solver conic_qp --max-iter 1 --tol 1e-300 --out /dev/full");
    assert_eq!(run.code, Some(6), "{run:?}");
    for code in ["    1  ", "  130  "] {
        assert!(place.run("solve --help").out.contains(code));
    }
}

/// In the midst of the second file the table of the first is there.
#[test]
fn ctrl_c_ends_the_second_of_two_files_and_keeps_the_first() {
    let place = place();
    let mut child = place.command(&endless()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(lines.by_ref().map(Result::unwrap).any(|line| line.contains("one.dat: 1 block")));
    interrupt(child.id());
    let rest: Vec<_> = lines.map(Result::unwrap).collect();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(rest.iter().any(|line| line.contains("gauss_seidel")), "the table of the first: {rest:?}");
}

#[test]
fn ctrl_c_leaves_json_whole_with_what_was_solved() {
    let place = place();
    // On a machine that is busy the first file may take its time.
    for seconds in [1, 4, 16] {
        let mut command = place.command(&format!("{} --json", endless()));
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs(seconds));
        interrupt(child.id());
        let run = Outcome::new(child.wait_with_output().unwrap());
        // Before its handler stands a signal ends the program itself.
        if run.code.is_none() {
            continue;
        }
        assert_eq!(run.code, Some(130), "{run:?}");
        let told: serde_json::Value = serde_json::from_str(&run.out).unwrap();
        match told.as_array().map(Vec::as_slice) {
            Some([]) => continue,
            Some([first, ..]) => assert_eq!(first["file"], "one.dat"),
            None => panic!("no list"),
        }
        return;
    }
    panic!("the first file was not solved in 16 s");
}

#[test]
fn a_hard_link_to_the_input_is_not_overwritten() {
    let place = place();
    std::fs::hard_link(place.path("one.dat"), place.path("link.json")).unwrap();
    std::os::unix::fs::symlink(place.path("one.dat"), place.path("soft.json")).unwrap();
    for link in ["link.json", "soft.json"] {
        let run = place.run(&format!("solve one.dat --out {link}"));
        assert!(run.code == Some(2) && run.err.contains("overwrite"), "{run:?}");
    }
    std::fs::hard_link(place.path("scene.toml"), place.path("steps.csv")).unwrap();
    let run = place.run("run scene.toml --lockstep --steps 1 --no-trace --csv steps.csv");
    assert!(run.code == Some(2) && run.err.contains("overwrite"), "{run:?}");
    assert_eq!(place.text("one.dat"), ONE);
}

/// Nothing is made where the data that was asked for is not there.
#[test]
fn a_chart_without_its_data_makes_no_folder() {
    let place = Place::new();
    let run = place.run("chart solvers --data missing --out charts");
    assert!(run.code == Some(2) && run.err.contains("--data missing"), "{run:?}");
    assert!(!place.path("charts").exists());
}
