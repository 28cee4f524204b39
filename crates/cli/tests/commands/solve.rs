//! `palpate solve` and `palpate run --save-problems`: what is saved is solved, and the exit code says whether.

use crate::program_runs::{Place, SCENE};
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

/// A problem of FCLIB, written by the HDF5 library, with forces that it holds as its solution and a guess to start from.
#[test]
fn problems_of_fclib_are_solved() {
    let place = Place::new();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../solver/tests/fclib/rows.hdf5");
    std::fs::copy(file, place.path("rows.hdf5")).unwrap();
    let run = place.run("solve rows.hdf5 --solver all --tol 1e-8 --warm");
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(run.out.contains("rows.hdf5: 4 blocks, 12 rows"), "{}", run.out);
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

/// Relaxed or in another order, sweeps end at the same forces, after other numbers of sweeps.
#[test]
fn gauss_seidel_takes_relaxation_and_order() {
    let place = Place::new();
    place.write("two.dat", FRICTION);
    let sweeps = |more: &str| {
        let run = place.run(&format!("solve two.dat --solver gauss_seidel --tol 1e-10 --json --out out.json {more}"));
        assert_eq!(run.code, Some(0), "{run:?}");
        let told: serde_json::Value = serde_json::from_str(&run.out).unwrap();
        let solution: serde_json::Value = serde_json::from_str(&place.text("out.json")).unwrap();
        let lambda: Vec<f64> = serde_json::from_value(solution["lambda"].clone()).unwrap();
        (told[0]["runs"][0]["report"]["iterations"].as_u64().unwrap(), lambda)
    };
    let (plain, forces) = sweeps("");
    for more in ["--relaxation 0.5", "--sweep-order symmetric", "--sweep-order shuffled --relaxation 0.8"] {
        let (_, others) = sweeps(more);
        assert!(forces.iter().zip(&others).all(|(a, b)| (a - b).abs() < 1e-8), "{more}: {forces:?} {others:?}");
    }
    assert!(sweeps("--relaxation 0.5").0 > plain, "smaller changes need more sweeps");
    let run = place.run("solve two.dat --relaxation 0.5");
    assert!(run.code == Some(2) && run.err.contains("for Gauss-Seidel"), "{run:?}");
    assert_eq!(place.run("solve two.dat --solver gauss_seidel --relaxation 1.5").code, Some(2));
    assert_eq!(place.run("solve two.dat --solver gauss_seidel --sweep-order random").code, Some(2));
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
        ("solve fclib.hdf5", &["fclib.hdf5", "HDF5", "damaged", "write it again"]),
        ("solve two.dat --solver newton", &["newton", "semismooth_newton"]),
        ("solve two.dat --tol 0", &["--tol", "positive"]),
        ("solve two.dat two.dat --out s.json", &["--out", "one FILE"]),
        ("solve two.dat --out absent/s.json", &["--out", "absent/s.json"]),
        ("solve", &["FILE"]),
        ("solve two.dat --warm", &["--warm", "two.dat", "no forces"]),
        ("run scene.toml --force", &["--save-problems"]),
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

/// Names of the files in a folder, sorted.
fn names(place: &Place, folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(place.path(folder)).unwrap();
    let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

/// Bits of an array of numbers.
fn bits(array: &serde_json::Value) -> Vec<u64> {
    array.as_array().unwrap().iter().map(|x| x.as_f64().unwrap().to_bits()).collect()
}

/// What a run solved is solved again from its file: to the same bits, by the scene's solver from the forces that it began
/// with. Gauss-Seidel is deterministic, and its warm start ends sooner than a cold one.
#[test]
fn problems_of_a_run_are_saved_and_solved_to_the_same_bits() {
    let place = Place::with(&format!("{SCENE}\n[solver]\nkind = \"gauss_seidel\"\n"));
    let run = place.run("run scene.toml --lockstep --no-trace --quiet --save-problems problems");
    assert_eq!(run.code, Some(0), "{run:?}");
    let files = names(&place, "problems");
    assert!(run.out.contains(&format!("{} contact problems saved in problems", files.len())), "{}", run.out);
    assert!(files.len() > 5 && files.len() < 31, "the ball touches for a part of 30 steps: {files:?}");
    assert!(files.iter().all(|name| name.ends_with("-pass-00001.json")), "one problem a step: {files:?}");
    let sweeps = |solution: &str| json(&place.text(solution))["report"]["iterations"].as_u64().unwrap();
    let (mut warm, mut cold) = (0, 0);
    for name in &files {
        let file = json(&place.text(&format!("problems/{name}")));
        let with = "--solver gauss_seidel --tol 1e-6 --max-iter 2000 --out";
        let solved = place.run(&format!("solve problems/{name} --warm {with} warm.json"));
        assert_eq!(solved.code, Some(0), "{solved:?}");
        assert_eq!(bits(&json(&place.text("warm.json"))["lambda"]), bits(&file["lambda"]), "{name}");
        assert_eq!(place.run(&format!("solve problems/{name} {with} cold.json")).code, Some(0));
        (warm, cold) = (warm + sweeps("warm.json"), cold + sweeps("cold.json"));
    }
    assert!(warm < cold, "{warm} sweeps from the run's start, {cold} from none");

    // The same problems from a second run, to the byte.
    assert_eq!(place.run("run scene.toml --lockstep --no-trace --quiet --save-problems again").code, Some(0));
    assert_eq!(names(&place, "again"), files);
    assert!(files.iter().all(|f| place.read(&format!("problems/{f}")) == place.read(&format!("again/{f}"))));
}

/// Motion and forces of Newton's method take turns, explicit substeps have contact each: every problem is there.
#[test]
fn every_problem_of_a_step_has_its_file() {
    for (integrator, least) in [("integrator = \"newton\"", 2), ("integrator = \"explicit\"", 20)] {
        let place = Place::with(&SCENE.replace("density = 1060", &format!("density = 1060\n{integrator}")));
        let run = place.run("run scene.toml --lockstep --steps 12 --no-trace --quiet --save-problems problems");
        assert_eq!(run.code, Some(0), "{run:?}");
        let files = names(&place, "problems");
        let last = &files.last().unwrap()["step-".len()..][..6];
        let passes: Vec<_> = files.iter().filter(|f| f[5..].starts_with(last)).collect();
        assert!(passes.len() >= least, "{integrator}: {passes:?}");
        for (k, name) in passes.iter().enumerate() {
            assert_eq!(**name, format!("step-{last}-pass-{:05}.json", k + 1), "{integrator}");
        }
        assert_eq!(place.run(&format!("solve problems/{}", passes[0])).code, Some(0));
    }
}

#[test]
fn problems_of_two_runs_do_not_mix() {
    let place = Place::new();
    let save = |steps: u32, more: &str| {
        place.run(&format!("run scene.toml --lockstep --steps {steps} --no-trace --quiet --save-problems p {more}"))
    };
    assert_eq!(save(15, "").code, Some(0));
    place.write("p/notes.txt", "mine");
    let (first, count) = (names(&place, "p")[1].clone(), names(&place, "p").len());
    let refused = save(14, "");
    assert_eq!(refused.code, Some(2), "{refused:?}");
    for word in ["--save-problems p", "earlier run", &first, "--force"] {
        assert!(refused.err.contains(word), "{word}: {}", refused.err);
    }
    assert_eq!(names(&place, "p").len(), count, "nothing is touched by a refusal");
    assert_eq!(save(14, "--force").code, Some(0));
    assert_eq!(names(&place, "p").len(), count - 1, "one step less");
    assert_eq!(place.text("p/notes.txt"), "mine");

    // A folder that cannot be made is told before anything runs.
    place.write("file", "");
    for folder in ["file", "file/problems"] {
        let refused = place.run(&format!("run scene.toml --lockstep --steps 2 --no-trace --save-problems {folder}"));
        assert_eq!(refused.code, Some(2), "{refused:?}");
        assert!(refused.err.contains(&format!("--save-problems {folder}")), "{}", refused.err);
    }
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
