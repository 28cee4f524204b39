//! Problem files: what is written reads back to the same bits, and nothing that is read can do harm.

use nalgebra::{DMatrix, DVector};
use palpate_constraints::law::{Bilateral, Coulomb, Law, Signorini};
use palpate_solver::problem::{ConstraintProblem, ProblemError};
use palpate_solver::problem_file::{self, Forces, ProblemFileError, siconos};
use proptest::prelude::*;

fn laws(friction: f64) -> [Law; 3] {
    [Coulomb { friction }.into(), Signorini.into(), Bilateral { rows: 2 }.into()]
}

fn bits(problem: &ConstraintProblem) -> Vec<u64> {
    problem.compliance().iter().chain(problem.delta_free()).map(|x| x.to_bits()).collect()
}

fn sample() -> String {
    let w = DMatrix::from_fn(6, 6, |i, j| if i == j { 1e-3 } else { 1e-4 / (1.0 + (i + j) as f64) });
    let problem = ConstraintProblem::new(w, DVector::from_element(6, -1e-3), laws(0.3)).unwrap();
    let mut text = Vec::new();
    problem_file::write(&problem, &mut text).unwrap();
    String::from_utf8(text).unwrap()
}

const FRICTION: &str = "3\n2\n1\n6\n6\n2\n2\n2\n3 6\n3 6\n3\n2\n0 1 2\n0 1\n\
    0\n1 0 0\n0 2 0\n0 0 3\n1\n4 0 0\n0 5 0\n0 0 6\n-1 0 0 -1 0 0\n0.1 0.2\n";
const DENSE: &str = "2\n0\n2\n2\n2\t2\n2 1\n1 2\n-5 -6\n0\n";

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn saved_and_loaded_gives_the_same_bits(
        w in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO, 36),
        free in prop::array::uniform6(prop::num::f64::NORMAL | prop::num::f64::ZERO), friction in 0.0..2.0_f64,
    ) {
        let w = DMatrix::from_vec(6, 6, w);
        let problem = ConstraintProblem::new(w, DVector::from_column_slice(&free), laws(friction)).unwrap();
        let mut text = Vec::new();
        problem_file::write(&problem, &mut text).unwrap();
        let read = problem_file::read(text.as_slice()).unwrap();
        prop_assert_eq!(bits(&read), bits(&problem));
        prop_assert_eq!(read.blocks(), problem.blocks());
    }

    // Readers get valid files with a few bytes changed or cut: they answer, and what they accept can be checked.
    #[test]
    fn damaged_files_are_refused_or_read(
        which in 0..3_usize, edits in prop::collection::vec((any::<prop::sample::Index>(), 0x20..0x7f_u8), 1..6),
        cut in any::<prop::sample::Index>(), shorten in any::<bool>(),
    ) {
        let mut text = [sample(), FRICTION.to_owned(), DENSE.to_owned()][which].clone().into_bytes();
        for (at, byte) in edits {
            let at = at.index(text.len());
            text[at] = byte;
        }
        if shorten {
            text.truncate(cut.index(text.len()));
        }
        let text = String::from_utf8(text).unwrap();
        let read = match which {
            0 => problem_file::read(text.as_bytes()),
            1 => siconos::read_friction(&text),
            _ => siconos::read_lcp(&text),
        };
        if let Ok(problem) = read {
            prop_assert!(problem.view().is_consistent());
            let _ = problem.validate();
        }
        // Whatever it has become, the reader of all formats answers too.
        let _ = siconos::read(&text);
    }

    #[test]
    fn any_words_are_refused_or_read(words in prop::collection::vec(0..40_u64, 0..60), big in any::<u64>()) {
        for scale in [1, big] {
            let text = words.iter().map(|w| w.wrapping_mul(scale).to_string()).collect::<Vec<_>>().join(" ");
            for head in ["", "3 1 1 ", "3 1 0 3 3 3 3 ", "0 1 0 0 ", "3 0 1 0 0 1 0 0 "] {
                let text = format!("{head}{text}");
                let _ = siconos::read_friction(&text);
                let _ = siconos::read_lcp(&text);
            }
        }
    }
}

#[test]
fn both_matrix_storages_are_read() {
    let problem = siconos::read_friction(FRICTION).unwrap();
    let diagonal: Vec<f64> = problem.compliance().diagonal().iter().copied().collect();
    assert_eq!(diagonal, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(problem.blocks()[1].law, Coulomb { friction: 0.2 }.into());

    // Column by column: the second word is W[1, 0].
    let lcp = siconos::read_lcp("2 0 2 2 2 2  1 7  8 2  -5 -6").unwrap();
    assert_eq!((lcp.compliance()[(1, 0)], lcp.compliance()[(0, 1)]), (7.0, 8.0));
    assert_eq!(lcp.delta_free(), [-5.0, -6.0]);
}

#[test]
fn a_mistake_in_a_text_file_names_its_line() {
    let broken = DENSE.replace("1 2\n", "1 two\n");
    let error = siconos::read_lcp(&broken).unwrap_err();
    assert_eq!(error.to_string(), "line 7: expected entry of the matrix, found `two`");
    let error = siconos::read_friction("2\n1\n").unwrap_err();
    assert!(error.to_string().starts_with("line 1: expected dimension 3"), "{error}");
    assert!(matches!(siconos::read_lcp("4000000000 0"), Err(ProblemFileError::TooLarge { rows: 4_000_000_000 })));
    assert!(siconos::read_lcp("").unwrap_err().to_string().ends_with("found the end of the file"));
}

#[test]
fn files_of_another_kind_or_version_are_refused() {
    let other = sample().replace("\"version\":1", "\"version\":7");
    assert!(matches!(problem_file::read(other.as_bytes()), Err(ProblemFileError::Format { version: 7, .. })));
    let moved = sample().replace("\"start\":3", "\"start\":2");
    let error = problem_file::read(moved.as_bytes()).unwrap_err();
    assert!(matches!(error, ProblemFileError::Problem(ProblemError::WrongBlock { block: 1, .. })), "{error}");
    assert!(problem_file::read(&b"{}"[..]).is_err());
}

#[test]
fn a_file_on_disk_and_a_missing_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("press.json");
    let problem = problem_file::read(sample().as_bytes()).unwrap();
    problem_file::save(&problem, &path).unwrap();
    assert_eq!(problem_file::load(&path).unwrap(), problem);
    let missing = folder.path().join("absent.json");
    assert!(problem_file::load(&missing).unwrap_err().to_string().contains("absent.json"));
    let nan =
        ConstraintProblem::new(DMatrix::from_element(1, 1, f64::NAN), DVector::zeros(1), [Signorini.into()]).unwrap();
    assert!(problem_file::write(&nan, Vec::new()).unwrap_err().to_string().contains("W[0, 0]"));
}

#[test]
fn validation_names_the_row() {
    let good = || DMatrix::from_diagonal_element(6, 6, 1e-3);
    let free = DVector::zeros(6);
    let check = |w: DMatrix<f64>, free: &DVector<f64>, friction: f64| {
        ConstraintProblem::new(w, free.clone(), laws(friction)).and_then(|problem| problem.validate())
    };
    assert_eq!(check(good(), &free, 0.3), Ok(()));

    let mut w = good();
    w[(1, 4)] = 1e-5;
    let Err(ProblemError::NotSymmetric { row: 1, column: 4, asymmetry, .. }) = check(w, &free, 0.3) else { panic!() };
    assert!((asymmetry - 1e-2).abs() < 1e-12);

    let mut w = good();
    w[(5, 5)] = -1e-3;
    assert_eq!(check(w, &free, 0.3), Err(ProblemError::NegativeDiagonal { row: 5, value: -1e-3 }));

    let mut w = good();
    w[(2, 3)] = f64::INFINITY;
    let expected = ProblemError::NonFiniteCompliance { row: 2, column: 3, value: f64::INFINITY };
    assert_eq!(check(w, &free, 0.3), Err(expected));

    let mut gap = free.clone();
    gap[4] = f64::NEG_INFINITY;
    let expected = ProblemError::NonFiniteGap { row: 4, value: f64::NEG_INFINITY };
    assert_eq!(check(good(), &gap, 0.3), Err(expected));

    assert!(matches!(check(good(), &free, -0.3), Err(ProblemError::Law { block: 0, row: 0, .. })));
    assert!(matches!(check(DMatrix::zeros(5, 6), &free, 0.3), Err(ProblemError::WrongSize { w_rows: 5, .. })));
    let short = ConstraintProblem::new(good(), free.clone(), [Coulomb { friction: 0.1 }.into()]);
    assert_eq!(short, Err(ProblemError::RowsWithoutLaw { first: 3, rows: 6 }));
    let long = ConstraintProblem::new(good(), free.clone(), [Coulomb { friction: 0.1 }.into(); 3]);
    assert!(matches!(long, Err(ProblemError::WrongBlock { block: 2, start: 6, .. })));
}

#[test]
fn formats_are_told_apart_by_their_content() {
    let folder = tempfile::tempdir().unwrap();
    let open = |bytes: &[u8]| {
        let path = folder.path().join("problem");
        std::fs::write(&path, bytes).unwrap();
        problem_file::open(&path)
    };
    assert_eq!(open(format!("\n  {}", sample()).as_bytes()).unwrap(), problem_file::read(sample().as_bytes()).unwrap());
    assert_eq!(open(FRICTION.as_bytes()).unwrap(), siconos::read_friction(FRICTION).unwrap());
    assert_eq!(open(DENSE.as_bytes()).unwrap(), siconos::read_lcp(DENSE).unwrap());
    // Three rows: the text begins as a friction problem would.
    let three = "3 0 3 3 3 3 1 0 0 0 1 0 0 0 1 -1 -1 -1";
    assert_eq!(open(three.as_bytes()).unwrap().blocks().len(), 3);
    assert!(open(b"\x89HDF\r\n\x1a\n....").unwrap_err().to_string().starts_with("HDF5"));
    let error = open(b"2\n0\n\xff").unwrap_err().to_string();
    assert_eq!(error, "line 3: neither JSON nor text: byte 4 of the file is not UTF-8");
    assert!(matches!(open(b" \n"), Err(ProblemFileError::Empty)));
    assert!(open(b"3").unwrap_err().to_string().contains("line 1"));
    assert!(open(b"{\"format\": 3}").unwrap_err().to_string().contains("line 1 column"));
}

/// Forces go along with a problem, to the bit, and do not belong to it.
#[test]
fn forces_are_saved_and_loaded_with_their_problem() {
    let problem = problem_file::read(sample().as_bytes()).unwrap();
    let start: Vec<f64> = (0..6).map(|k| 0.1 * f64::from(k) / 3.0).collect();
    let forces = Forces { start: Some(start), lambda: Some(vec![-0.0, f64::MIN_POSITIVE / 3.0, 1.0, 2.0, 3.0, 1e300]) };
    let mut text = Vec::new();
    problem_file::write_with_forces(&problem, &forces, &mut text).unwrap();
    let (read, found) = problem_file::read_with_forces(text.as_slice()).unwrap();
    assert_eq!(bits(&read), bits(&problem));
    let words = |forces: &Option<Vec<f64>>| forces.as_ref().unwrap().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!((words(&found.start), words(&found.lambda)), (words(&forces.start), words(&forces.lambda)));
    assert_eq!(problem_file::read_with_forces(sample().as_bytes()).unwrap().1, Forces::default());

    let short = Forces { start: Some(vec![0.0; 5]), ..Forces::default() };
    let told = problem_file::write_with_forces(&problem, &short, &mut Vec::new()).unwrap_err().to_string();
    assert!(told.contains("`start`") && told.contains("5 forces for 6 rows"), "{told}");
    let endless = Forces { lambda: Some(vec![0.0, 0.0, f64::INFINITY, 0.0, 0.0, 0.0]), ..Forces::default() };
    let told = problem_file::write_with_forces(&problem, &endless, &mut Vec::new()).unwrap_err().to_string();
    assert!(told.contains("lambda[2] = inf"), "{told}");
}
