//! Problems that are none, by `palpate solve`: an exit code and a sentence that names the row, and forces that are finite.

use crate::program_runs::Place;

/// A problem file: laws of the blocks, their first rows, gaps, columns of W.
fn problem(blocks: &[(usize, &str)], delta_free: &str, columns: &str) -> String {
    let blocks: Vec<_> = blocks.iter().map(|(start, law)| format!(r#"{{"start":{start},"law":{law}}}"#)).collect();
    let blocks = blocks.join(",");
    format!(
        r#"{{"format":"palpate-contact-problem","version":1,"blocks":[{blocks}],"delta_free":{delta_free},"compliance":{columns}}}"#
    )
}

const CONTACT: &str = r#"{"type":"signorini"}"#;
const CLOSED: &str = r#"{"type":"bilateral","rows":1}"#;

#[test]
fn numbers_that_no_compliance_has_are_named_with_their_row() {
    let place = Place::new();
    let two = |law: &str, free: &str, w: &str| problem(&[(0, law), (1, law)], free, w);
    let rubbing = r#"{"type":"coulomb","friction":-0.3}"#;
    let cases: &[(&str, String, &[i32], &[&str])] = &[
        // Warned of, and solved where some solver can.
        ("asymmetric", two(CONTACT, "[-1,-1]", "[[2,1],[0.5,2]]"), &[0], &["warning", "W[0, 1]", "0.5", "W[1, 0]"]),
        ("indefinite", two(CONTACT, "[-1,-1]", "[[1,2],[2,1]]"), &[0, 6], &["warning", "W[0, 1] = 2"]),
        ("negative", two(CONTACT, "[-1,-1]", "[[1,0],[0,-1]]"), &[0, 6], &["warning", "W[1, 1] = -1"]),
        (
            "hidden",
            problem(
                &[(0, CONTACT), (1, CONTACT), (2, CONTACT)],
                "[-1,-1,-1]",
                "[[1,-0.8,-0.8],[-0.8,1,-0.8],[-0.8,-0.8,1]]",
            ),
            &[0, 6],
            &["warning", "row 2", "pivot"],
        ),
        // Refused.
        ("infinite", two(CONTACT, "[-1,-1]", "[[1,0],[0,1e999]]"), &[2], &["infinite.json", "line 1", "out of range"]),
        ("friction", problem(&[(0, rubbing)], "[-1,0,0]", "[[1,0,0],[0,1,0],[0,0,1]]"), &[2], &["rows from 0", "-0.3"]),
        ("limit", two(r#"{"type":"threshold","limit":-2}"#, "[-1,-1]", "[[1,0],[0,1]]"), &[2], &["rows from 0", "-2"]),
        ("sizes", two(CONTACT, "[-1,-1]", "[[1,0],[0]]"), &[2], &["W is 1 x 2", "2 rows"]),
        ("columns", two(CONTACT, "[-1,-1]", "[[1,0]]"), &[2], &["W is 2 x 1", "2 rows"]),
        ("lawless", problem(&[(0, CONTACT)], "[-1,-1]", "[[1,0],[0,1]]"), &[2], &["rows 1..2", "law"]),
        ("overlap", problem(&[(0, CONTACT), (0, CONTACT)], "[-1,-1]", "[[1,0],[0,1]]"), &[2], &["block 1", "row"]),
        ("unknown", two(r#"{"type":"glue"}"#, "[-1,-1]", "[[1,0],[0,1]]"), &[2], &["glue", "bilateral"]),
    ];
    for (name, text, codes, words) in cases {
        place.write(&format!("{name}.json"), text);
        let run = place.run(&format!("solve {name}.json --solver all --out {name}.solution"));
        assert!(codes.contains(&run.code.unwrap_or(-1)), "{name}: {run:?}");
        for word in *words {
            assert!(run.err.contains(word), "{name}: `{word}` in {}", run.err);
        }
        assert!(run.err.contains(&format!("{name}.json")), "{name}: {}", run.err);
        let written = place.path(&format!("{name}.solution")).exists();
        assert_eq!(written, run.code != Some(2), "{name}");
        if written {
            let solution: serde_json::Value = serde_json::from_str(&place.text(&format!("{name}.solution"))).unwrap();
            let forces: Vec<f64> = serde_json::from_value(solution["lambda"].clone()).unwrap();
            assert!(forces.iter().all(|f| f.is_finite() && *f >= 0.0 && *f < 1e12), "{name}: {forces:?}");
        }
    }
    // JSON has no NaN; a text of Siconos has.
    place.write("nan.dat", "2\n0\n2\n2\n2 2\n2 1\n1 nan\n-5 -6\n");
    let run = place.run("solve nan.dat");
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.err.contains("nan.dat"), "{}", run.err);
}

/// Two closed rows on one motion that want two gaps: no force opens both, and the sentence says which rows.
#[test]
fn closed_rows_that_conflict_are_named() {
    let place = Place::new();
    place.write("closed.json", &problem(&[(0, CLOSED), (1, CLOSED)], "[-1,1]", "[[1,1],[1,1]]"));
    for solver in ["automatic", "all"] {
        let run = place.run(&format!("solve closed.json --solver {solver} --time-limit 5 --out s.json"));
        assert_eq!(run.code, Some(6), "{run:?}");
        assert!(run.out.contains("`bilateral`, row") && run.out.contains("conflict"), "{}", run.out);
        let solution: serde_json::Value = serde_json::from_str(&place.text("s.json")).unwrap();
        let forces: Vec<f64> = serde_json::from_value(solution["lambda"].clone()).unwrap();
        assert!(forces.iter().all(|f| f.is_finite()), "{forces:?}");
    }
}

/// What a new user may hand over by mistake.
#[test]
fn what_is_no_problem_at_all_is_told_with_a_remedy() {
    let place = Place::new();
    place.write("empty.dat", "");
    place.write("blank.json", " \n\n");
    std::fs::write(place.path("picture.png"), b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\xff\xfe").unwrap();
    std::fs::create_dir(place.path("folder")).unwrap();
    let cases: &[(&str, &[&str])] = &[
        ("solve absent.json", &["absent.json", "No such file", "--save-problems"]),
        ("solve folder", &["folder", "folder/*"]),
        ("solve empty.dat", &["empty.dat", "empty", "--save-problems"]),
        ("solve blank.json", &["blank.json", "empty", "--save-problems"]),
        ("solve picture.png", &["picture.png", "neither", "--save-problems"]),
        ("solve scene.toml", &["scene.toml", "line 1", "--save-problems"]),
        ("solve empty.dat --tol 0", &["--tol", "`0`", "1e-6"]),
        ("solve empty.dat --tol nan", &["--tol", "`nan`", "1e-6"]),
        ("solve empty.dat --tol tight", &["--tol", "`tight`", "1e-6"]),
        ("solve empty.dat --max-iter 0", &["--max-iter", "at least 1"]),
        ("solve empty.dat --max-iter -3", &["--max-iter", "at least 1"]),
        ("solve empty.dat --time-limit 0", &["--time-limit", "`0`"]),
        ("solve empty.dat --solver nonsense", &["nonsense", "gauss_seidel", "automatic"]),
        ("check folder", &["folder", "is a folder"]),
        ("check empty.dat", &["empty.dat", "empty", "palpate scenes"]),
        ("check picture.png", &["picture.png", "not a text file"]),
        ("plan absent.toml", &["absent.toml", "liver"]),
        ("chart solvers --out empty.dat", &["--out empty.dat", "folder"]),
        ("chart nonsense", &["nonsense", "tissue"]),
    ];
    for (arguments, words) in cases {
        let run = place.run(arguments);
        assert_eq!(run.code, Some(2), "{arguments}: {run:?}");
        for word in *words {
            // Messages quote values as 'x' or `x`.
            let said = run.err.replace('\'', "`");
            assert!(said.contains(word), "{arguments}: `{word}` in {}", run.err);
        }
    }
}
