//! Files of the Frictional Contact Library, written by the HDF5 library (`tests/fclib/write.py`).
#![cfg(feature = "fclib")]

use palpate_constraints::law::{Coulomb, Law};
use palpate_solver::problem_file::{self, Forces, ProblemFileError, fclib};
use std::path::PathBuf;

const ROWS: usize = 12;

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fclib").join(name)
}

fn message(bytes: Vec<u8>) -> String {
    fclib::read(bytes).unwrap_err().to_string()
}

/// The numbers of `write.py`, to the bit.
#[test]
fn every_kind_of_matrix_holds_the_same_problem() {
    for name in ["triplets.hdf5", "columns.hdf5", "rows.hdf5", "latest.hdf5"] {
        let (problem, forces) = problem_file::open_with_forces(&path(name)).unwrap();
        assert_eq!((problem.rows(), problem.blocks().len()), (ROWS, 4), "{name}");
        problem.validate().unwrap();
        for j in 0..ROWS {
            for (i, &entry) in problem.view().column(j).iter().enumerate() {
                let apart = i.abs_diff(j);
                let near = if apart < 5 { 1.0 / (1.0 + apart as f64) } else { 0.0 };
                assert_eq!(entry, near + if i == j { 2.0 } else { 0.0 }, "{name} {i} {j}");
            }
            let q = if j % 3 == 0 { -1.0 } else { 0.25 } / (1.0 + j as f64);
            assert_eq!(problem.delta_free()[j], q, "{name} {j}");
        }
        for (k, block) in problem.blocks().iter().enumerate() {
            assert_eq!(block.law, Law::from(Coulomb { friction: 0.1 * (k as f64 + 1.0) }), "{name}");
        }
        let r: Vec<f64> = (0..ROWS).map(|k| 1.0 / (3.0 + k as f64)).collect();
        let guess = r.iter().map(|force| 0.5 * force).collect();
        let known = matches!(name, "rows.hdf5" | "latest.hdf5");
        let expected = if known { Forces { start: Some(guess), lambda: Some(r) } } else { Forces::default() };
        assert_eq!(forces, expected, "{name}");
    }
}

#[test]
fn what_is_not_read_is_named_with_its_remedy() {
    for (name, expected) in [
        ("plane.hdf5", "/fclib_local/spacedim is 2"),
        ("bilateral.hdf5", "/fclib_local/V: bilateral rows"),
        ("global.hdf5", "/fclib_global, a problem without W, is not read; condense it"),
    ] {
        let error = problem_file::open(&path(name)).unwrap_err().to_string();
        assert!(error.contains(expected), "{name}: {error}");
    }
    let start = b"\x89HDF\r\n\x1a\n".to_vec();
    assert!(message(start).contains("write it again"));
}

/// Damage is a sentence or is not noticed, where a number was hit; it never panics, and asks for no memory that the file
/// could not fill.
#[test]
fn damaged_files_are_refused_without_a_panic() {
    let whole = std::fs::read(path("rows.hdf5")).unwrap();
    let mut refused = 0;
    for length in (8..whole.len()).step_by(7) {
        assert!(message(whole[..length].to_vec()).starts_with("HDF5 (FCLIB): "), "cut at {length}");
    }
    for at in 8..whole.len() {
        for flip in [0x01, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            match fclib::read(bytes) {
                Ok((problem, _)) => assert_eq!(problem.rows() % 3, 0),
                Err(
                    ProblemFileError::Fclib { .. }
                    | ProblemFileError::TooLarge { .. }
                    | ProblemFileError::NonFiniteForce { .. }
                    | ProblemFileError::Problem(_),
                ) => refused += 1,
                Err(other) => panic!("byte {at}: {other}"),
            }
        }
    }
    assert!(refused > 1000, "{refused}");
}
