//! `palpate solve` and `palpate run --save-problems`: what is saved is solved, and the exit code says whether.

mod program_runs;

use program_runs::{Place, SCENE};
use proptest::prelude::*;

/// Two contacts with friction, as Siconos writes them.
const FRICTION: &str = "3\n2\n0\n6\n6\n6\n6\n\
    2 0 0 1 0 0\n0 2 0 0 0 0\n0 0 2 0 0 0\n1 0 0 2 0 0\n0 0 0 0 2 0\n0 0 0 0 0 2\n\
    -1 0.5 0 -1 0 0\n0.3 0.3\n";

/// Rows that conflict: no force opens both gaps.
const CONFLICT: &str = "2\n0\n2\n2\n2\n2\n1 -1\n-1 1\n-1 -1\n";

#[test]
fn the_table_names_solver_status_and_residual() {
    let place = Place::new();
    place.write("two.dat", FRICTION);
    let run = place.run("solve two.dat");
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(run.out.contains("two.dat: 2 blocks, 6 rows"), "{}", run.out);
    assert!(run.out.contains("automatic") && run.out.contains("solved"), "{}", run.out);

    let all = place.run("solve two.dat --solver all --tol 1e-9");
    assert_eq!(all.code, Some(0), "{all:?}");
    for name in
        ["gauss_seidel", "nncg", "semismooth_newton", "lemke", "conic_qp", "conic_friction", "accelerated_gradient"]
    {
        assert!(all.out.contains(name), "{name}: {}", all.out);
    }
    assert!(all.out.contains("not for this problem"), "friction is not for conic_qp: {}", all.out);
}

#[test]
fn the_exit_code_says_whether_the_tolerance_was_met() {
    let place = Place::new();
    place.write("conflict.dat", CONFLICT);
    place.write("two.dat", FRICTION);
    let run = place.run("solve conflict.dat --solver all");
    assert_eq!(run.code, Some(6), "{run:?}");
    assert_eq!(place.run("solve two.dat conflict.dat").code, Some(6), "one of two is not solved");
    let one = place.run("solve two.dat --solver gauss_seidel --tol 1e-12 --max-iter 1");
    assert_eq!(one.code, Some(6), "{one:?}");
    assert!(one.out.contains("limit of iterations"), "{}", one.out);
}

#[test]
fn json_and_solution_are_whole() {
    let place = Place::new();
    place.write("two.dat", FRICTION);
    let run = place.run("solve two.dat --solver all --json --out solution.json");
    assert_eq!(run.code, Some(0), "{run:?}");
    let told: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    let runs = told[0]["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 8);
    let newton = runs.iter().find(|run| run["solver"] == "semismooth_newton").unwrap();
    assert_eq!(newton["report"]["status"], "solved");
    assert!(!newton["history"].as_array().unwrap().is_empty());

    let solution: serde_json::Value = serde_json::from_str(&place.text("solution.json")).unwrap();
    let lambda: Vec<f64> = serde_json::from_value(solution["lambda"].clone()).unwrap();
    let delta: Vec<f64> = serde_json::from_value(solution["delta"].clone()).unwrap();
    // The first gap by hand: W_00 = 2, W_03 = 1, delta_free = -1; both contacts closed.
    assert!((delta[0] - (2.0 * lambda[0] + lambda[3] - 1.0)).abs() < 1e-15);
    assert!(delta[0].abs() < 1e-6 && lambda[0] > 0.0, "{delta:?} {lambda:?}");
}

#[test]
fn mistakes_name_file_line_and_remedy() {
    let place = Place::new();
    place.write("two.dat", FRICTION);
    place.write("broken.dat", &FRICTION.replace("0 2 0 0 0 0", "0 two 0 0 0 0"));
    place.write("negative.dat", &FRICTION.replace("0.3 0.3", "0.3 -0.3"));
    place.write("other.json", "{\n\"format\": \"something\",\n\"version\": \"one\"}");
    place.write("fclib.hdf5", "");
    std::fs::write(place.path("fclib.hdf5"), b"\x89HDF\r\n\x1a\n").unwrap();
    let cases: &[(&str, &[&str])] = &[
        ("solve absent.dat", &["absent.dat", "No such file"]),
        ("solve broken.dat", &["broken.dat", "line 9", "`two`"]),
        ("solve two.dat negative.dat", &["negative.dat", "block 1", "friction = -0.3"]),
        ("solve other.json", &["other.json", "line 3"]),
        ("solve fclib.hdf5", &["fclib.hdf5", "HDF5", "convert"]),
        ("solve two.dat --solver newton", &["newton", "semismooth_newton"]),
        ("solve two.dat --tol 0", &["--tol", "positive"]),
        ("solve two.dat two.dat --out s.json", &["--out", "one FILE"]),
        ("solve two.dat --out absent/s.json", &["--out", "absent/s.json"]),
        ("solve", &["FILE"]),
    ];
    for (arguments, expected) in cases {
        let run = place.run(arguments);
        assert_eq!(run.code, Some(2), "{arguments}: {run:?}");
        assert!(run.out.is_empty(), "{arguments}: {}", run.out);
        for word in *expected {
            assert!(run.err.contains(word), "{arguments}: `{word}` in {}", run.err);
        }
    }
}

#[test]
fn problems_of_a_run_are_saved_and_solved() {
    let place = Place::new();
    let run = place.run("run scene.toml --lockstep --no-trace --quiet --save-problems problems");
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(run.out.contains("contact problems saved in problems"), "{}", run.out);
    let mut files: Vec<_> = std::fs::read_dir(place.path("problems")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    assert!(files.len() > 5 && files.len() < 31, "the ball touches for a part of 30 steps: {}", files.len());
    let last = files.last().unwrap().file_name().unwrap().to_str().unwrap();
    assert!(last.starts_with("step-0000") && last.ends_with(".json"), "{last}");
    let solved = place.run(&format!("solve problems/{last} --tol 1e-8"));
    assert_eq!(solved.code, Some(0), "{solved:?}");

    // A folder that cannot be made is told before anything runs.
    place.write("file", "");
    let refused = place.run("run scene.toml --lockstep --steps 2 --no-trace --save-problems file/problems");
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("--save-problems file/problems"), "{}", refused.err);
}

/// The scene's solver at step rate is chosen by name, and the answer is the same.
#[test]
fn a_scene_names_its_solver() {
    let force = |kind: &str| {
        let place = Place::with(&format!("{SCENE}\n[solver]\nkind = \"{kind}\"\ntolerance = 1e-9\n"));
        let run = place.run("run scene.toml --lockstep --steps 20 --no-trace --quiet --json --csv steps.csv");
        assert_eq!(run.code, Some(0), "{kind}: {run:?}");
        let table = place.text("steps.csv");
        let column = table.lines().next().unwrap().split(',').position(|name| name == "force_z_n").unwrap();
        let last: f64 = table.lines().last().unwrap().split(',').nth(column).unwrap().parse().unwrap();
        last
    };
    let reference = force("gauss_seidel");
    assert!(reference.abs() > 1e-3, "the ball presses: {reference}");
    for kind in ["semismooth_newton", "automatic", "nncg"] {
        // 1e-9 of the gaps, summed over twenty steps of a soft block.
        let error = (force(kind) - reference).abs() / reference.abs();
        assert!(error <= 1e-6, "{kind}: {error:e}");
    }
    let place = Place::with(&format!("{SCENE}\n[solver]\nkind = \"gauss_siedel\"\n"));
    let run = place.run("check scene.toml");
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.err.contains("did you mean `gauss_seidel`?"), "{}", run.err);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    // The program answers any file with one of its codes and never panics.
    #[test]
    fn damaged_files_are_refused_or_solved(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..5), cut in any::<prop::sample::Index>(),
    ) {
        let place = Place::new();
        let mut bytes = FRICTION.as_bytes().to_vec();
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate(cut.index(bytes.len()).max(bytes.len() / 2));
        std::fs::write(place.path("damaged.dat"), &bytes).unwrap();
        let run = place.run("solve damaged.dat --time-limit 1");
        prop_assert!([Some(0), Some(2), Some(6)].contains(&run.code), "{run:?}");
        prop_assert!(!run.err.contains("panicked"), "{}", run.err);
    }
}
